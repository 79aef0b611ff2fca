"""A loop in the manner of CleanRL's `ppo_continuous_action`: its wrappers, one network, clipped PPO, all in one function."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torch import nn
from torch.distributions import Normal

import jostle

N_ENVS, N_STEPS, GAMMA, LAMBDA, CLIP = 4, 64, 0.99, 0.95, 0.2


def one_by_one() -> gymnasium.vector.VectorEnv:
    """Rooms in Gymnasium's own vector, each behind the wrappers that CleanRL puts around an environment."""

    def make() -> gymnasium.Env:
        env = gymnasium.make("jostle/Room-v0", crowd="SF", n_pedestrians=2)
        env = gymnasium.wrappers.FlattenObservation(env)
        env = gymnasium.wrappers.ClipAction(env)
        env = gymnasium.wrappers.NormalizeObservation(env)
        return gymnasium.wrappers.NormalizeReward(env, gamma=GAMMA)

    return SyncVectorEnv([make] * N_ENVS, autoreset_mode=AutoresetMode.SAME_STEP)


def all_at_once() -> gymnasium.vector.VectorEnv:
    """The same rooms by their own vector."""
    return gymnasium.make_vec(
        "jostle/Room-v0", num_envs=N_ENVS, vectorization_mode="vector_entry_point", crowd="SF", n_pedestrians=2
    )


@pytest.mark.parametrize("make", [one_by_one, all_at_once])
def test_a_loop_of_cleanrls_kind_learns_on_rooms(make: Callable[[], gymnasium.vector.VectorEnv]) -> None:
    torch.manual_seed(0)
    torch.set_num_threads(1)
    envs = RecordEpisodeStatistics(make())
    width = envs.single_observation_space.shape[0]
    trunk = nn.Sequential(nn.Linear(width, 64), nn.Tanh())
    actor, critic, log_std = nn.Linear(64, 2), nn.Linear(64, 1), nn.Parameter(torch.zeros(2))
    parameters = [*trunk.parameters(), *actor.parameters(), *critic.parameters(), log_std]
    optimizer = torch.optim.Adam(parameters, lr=3e-4)
    before = [parameter.detach().clone() for parameter in parameters]

    def forward(rows: torch.Tensor) -> tuple[Normal, torch.Tensor]:
        hidden = trunk(rows)
        return Normal(actor(hidden), log_std.exp()), critic(hidden)[..., 0]

    observation = torch.as_tensor(envs.reset(seed=1)[0], dtype=torch.float32)
    lengths: list[int] = []
    # 448 steps: the time limit of 400 ends an episode in every room, whatever is learned.
    for _ in range(7):
        kept: list[tuple[torch.Tensor, ...]] = []
        for _ in range(N_STEPS):
            with torch.no_grad():
                policy, value = forward(observation)
                action = policy.sample()
            after, reward, terminated, truncated, infos = envs.step(action.numpy())
            done = terminated | truncated
            kept.append(
                (
                    observation,
                    action,
                    policy.log_prob(action).sum(-1),
                    value,
                    torch.as_tensor(reward, dtype=torch.float32),
                    torch.as_tensor(done, dtype=torch.float32),
                )
            )
            if done.any():
                lengths += infos["episode"]["l"][done].tolist()
                assert set(infos["final_info"]["outcome"][done]) <= {
                    "success",
                    "collision_wall",
                    "collision_pedestrian",
                    "timeout",
                }
            observation = torch.as_tensor(after, dtype=torch.float32)
        rows, actions, log_probs, values, rewards, dones = (torch.stack(part) for part in zip(*kept, strict=True))
        with torch.no_grad():
            following, advantage = forward(observation)[1], torch.zeros(N_ENVS)
        advantages = torch.zeros_like(rewards)
        for t in reversed(range(N_STEPS)):
            delta = rewards[t] + GAMMA * following * (1 - dones[t]) - values[t]
            advantage = delta + GAMMA * LAMBDA * (1 - dones[t]) * advantage
            advantages[t], following = advantage, values[t]
        returns, normalised = advantages + values, (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        for _ in range(2):
            policy, value = forward(rows)
            ratio = (policy.log_prob(actions).sum(-1) - log_probs).exp()
            clipped = torch.min(ratio * normalised, ratio.clamp(1 - CLIP, 1 + CLIP) * normalised)
            loss = -clipped.mean() + 0.5 * (value - returns).square().mean() - 0.001 * policy.entropy().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, 0.5)
            optimizer.step()
    assert len(lengths) >= N_ENVS and all(0 < length <= 400 for length in lengths)
    assert all(torch.isfinite(parameter).all() for parameter in parameters)
    assert all(not torch.equal(old, new) for old, new in zip(before, parameters, strict=True))
    # What it learned is tested as anything else.
    def act(observations: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return forward(torch.from_numpy(observations))[0].mean.numpy()

    assert jostle.evaluate(act, "SF", episodes=4, n_pedestrians=2).episodes == 4
