// RVO2 on the scene of crates/bench/src/crowds.rs: `rvo2_driver orca-N 1`, the line protocol of rounds.py.
//
// Built beside RVO2's own sources with `-O3 -DNDEBUG -DRVO_STATIC_DEFINE -I SRC`, without OpenMP: one
// thread. One agent on 4 m², random starts and goals; every round starts anew, so that each does the same steps.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cmath>
#include <ctime>
#include <string>
#include <vector>

#include "RVOSimulator.h"
#include "Vector2.h"

#ifndef RVO2_VERSION
#define RVO2_VERSION "of unknown commit"
#endif

namespace {

std::uint64_t generator_state;

float uniform() {
  generator_state = generator_state * 6364136223846793005ULL + 1442695040888963407ULL;
  return static_cast<float>(static_cast<double>(generator_state >> 11) / 9007199254740992.0);
}

RVO::Vector2 point(float side) {
  const float x = uniform() * side;
  return RVO::Vector2(x, uniform() * side);
}

double now() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void step(RVO::RVOSimulator &simulator, const std::vector<RVO::Vector2> &goals) {
  for (std::size_t i = 0; i < goals.size(); ++i) {
    RVO::Vector2 preferred = goals[i] - simulator.getAgentPosition(i);
    if (RVO::absSq(preferred) > 1.0F) preferred = RVO::normalize(preferred);
    simulator.setAgentPrefVelocity(i, preferred);
  }
  simulator.doStep();
}

void round_of(std::size_t n) {
  generator_state = 1;
  RVO::RVOSimulator simulator(0.1F, 15.0F, 10, 5.0F, 5.0F, 0.35F, 1.0F);
  std::vector<RVO::Vector2> goals;
  const float side = std::sqrt(static_cast<float>(n) * 4.0F);
  for (std::size_t i = 0; i < n; ++i) {
    simulator.addAgent(point(side));
    goals.push_back(point(side));
  }
  for (int k = 0; k < 20; ++k) step(simulator, goals);
  double check = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    check += simulator.getAgentPosition(i).x() + 2.0 * simulator.getAgentPosition(i).y();
  }
  const std::size_t n_steps = std::max<std::size_t>(30, std::min<std::size_t>(20000, 600000 / n));
  const double start = now();
  for (std::size_t k = 0; k < n_steps; ++k) step(simulator, goals);
  const double seconds = now() - start;
  std::printf("{\"seconds\": %.9f, \"units\": %.1f, \"check\": %.9g}\n", seconds,
              static_cast<double>(n_steps * n), check);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char **argv) {
  if (argc != 3 || std::string(argv[2]) != "1" || std::string(argv[1]).rfind("orca-", 0) != 0) {
    std::fputs("usage: rvo2_driver orca-N 1\n", stderr);
    return 2;
  }
  const std::size_t n = std::strtoul(argv[1] + 5, nullptr, 10);
  std::puts("{\"name\": \"RVO2\", \"version\": \"" RVO2_VERSION "\"}");
  std::fflush(stdout);
  for (int c = std::getchar(); c != EOF; c = std::getchar()) {
    if (c == '\n') round_of(n);
  }
  return 0;
}
