"""`parallel_env` by PettingZoo's own tests, and what it promises beyond them."""

from __future__ import annotations

import copy
import pickle
import warnings

import numpy as np
import pytest
from conftest import WRONG_SEEDS, same, seek
from pettingzoo.test import parallel_api_test, parallel_seed_test

import jostle


@pytest.mark.parametrize("keywords", [{}, {"n_agents": 3, "n_behaviours": 4, "observe_token": True}])
def test_pettingzoos_tests_have_nothing_to_say(keywords: dict) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(jostle.parallel_env(**keywords), num_cycles=1000)
        parallel_seed_test(lambda: jostle.parallel_env(**keywords), num_cycles=200)


def test_robots_leave_one_by_one_and_all_come_back_together() -> None:
    env = jostle.parallel_env(5, n_behaviours=3)
    outcomes = []
    for seed in range(6):
        observations, infos = env.reset(seed=seed)
        assert set(observations) == set(infos) == set(env.agents) == set(env.possible_agents)
        for _ in range(400):
            there = list(env.agents)
            actions = {agent: seek(observations[agent][None])[0] for agent in there}
            observations, rewards, terminated, truncated, infos = env.step(actions)
            assert all(set(given) == set(there) for given in (observations, rewards, terminated, truncated, infos))
            left = [agent for agent in there if terminated[agent] or truncated[agent]]
            assert env.agents == [agent for agent in there if agent not in left]
            outcomes += [infos[agent]["outcome"] for agent in left]
            for agent in there:
                assert env.observation_space(agent).contains(observations[agent])
                assert ("outcome" in infos[agent]) == (agent in left)
            if not env.agents:
                break
        assert not env.agents
        assert env.step({}) == ({}, {}, {}, {}, {})
    assert len(outcomes) == 30 and {"success", "collision_agent"} <= set(outcomes)


def test_who_has_left_is_no_longer_seen() -> None:
    """What waits beside a robot that has left sees what it would see alone."""
    quiet = {"sim.laser.noise_std": 0.0}
    both, alone = jostle.parallel_env(2, settings=quiet), jostle.parallel_env(1, settings=quiet)
    was_seen = 0
    for seed in range(8):
        seen, unseen = both.reset(seed=seed)[0]["robot_0"], alone.reset(seed=seed)[0]["robot_0"]
        was_seen += not np.array_equal(seen, unseen)
        waiting, left_since = {"robot_0": [0.0, 0.0], "robot_1": [1.0, 0.0]}, 0
        while left_since < 4 and "robot_0" in both.agents:
            seen = both.step(waiting)[0]["robot_0"]
            left_since += "robot_1" not in both.agents
        # Three scans after its last, nothing of the other is left.
        for _ in range(3):
            unseen = alone.step({"robot_0": [0.0, 0.0]})[0]["robot_0"]
        if "robot_0" in both.agents:
            np.testing.assert_array_equal(seen, unseen)
    assert was_seen > 2


def test_tokens_are_told_and_may_be_observed() -> None:
    env = jostle.parallel_env(5, n_behaviours=4, observe_token=True)
    seen = set()
    for seed in range(10):
        observations, infos = env.reset(seed=seed)
        for agent in env.agents:
            token = infos[agent]["token"]
            assert observations[agent][-4:].tolist() == np.eye(4)[token].tolist()
            assert observations[agent].shape == env.observation_space(agent).shape == (1544,)
            seen.add(token)
    assert seen == {0, 1, 2, 3}


def test_a_refused_step_leaves_every_robot_there() -> None:
    env, undisturbed = jostle.parallel_env(2), jostle.parallel_env(2)
    with pytest.raises(ValueError, match="^step: found no episode, expected a reset before it$"):
        env.step({})
    same(env.reset(seed=0), undisturbed.reset(seed=0))
    ahead = {agent: [1.0, 0.1] for agent in env.agents}
    for actions, message in [
        (None, "actions: found None, expected a dictionary with one for each robot"),
        ({"robot_0": [0.0, 0.0]}, "actions: found none for robot_1, expected one for each of robot_0, robot_1"),
        ({**ahead, "robot_2": [0.0, 0.0]}, "actions: found 'robot_2', expected robots among robot_0, robot_1"),
        ({**ahead, "robot_1": None}, "robot_1: actions: found None, expected numbers of shape (2,)"),
        ({**ahead, "robot_1": 0.5}, "robot_1: actions: found shape (), expected (2,)"),
        ({**ahead, "robot_1": [0.0] * 3}, "robot_1: actions: found shape (3,), expected (2,)"),
        ({**ahead, "robot_1": [np.nan, 0.0]}, "actions: found (NaN, 0) for robot 1, expected finite numbers"),
        ({**ahead, "robot_0": [0.0, np.inf]}, "actions: found (0, inf) for robot 0, expected finite numbers"),
    ]:
        with pytest.raises(ValueError) as error:
            env.step(actions)
        assert str(error.value) == message
        assert env.agents == ["robot_0", "robot_1"]
        same(env.step(ahead), undisturbed.step(ahead))


def test_a_refused_reset_changes_nothing() -> None:
    env, undisturbed = jostle.parallel_env(2, n_behaviours=3), jostle.parallel_env(2, n_behaviours=3)
    same(env.reset(seed=0), undisturbed.reset(seed=0))
    wrong = [({"seed": seed}, message) for seed, message in WRONG_SEEDS]
    wrong += [({"options": {"test_episode": 1}}, "options: found 'test_episode', expected no entry")]
    ahead = {agent: [0.5, 0.1] for agent in env.agents}
    for keywords, message in wrong:
        with pytest.raises(ValueError) as error:
            env.reset(**keywords)
        assert str(error.value) == message
        same(env.step(ahead), undisturbed.step(ahead))
    same(env.reset(options={}), undisturbed.reset())


def test_copies_and_pickles_go_on_bit_for_bit() -> None:
    env = jostle.parallel_env(4, n_behaviours=3, observe_token=True, render_mode="rgb_array")
    observations, _ = env.reset(seed=2)
    n_left = 0
    for step in range(400):
        if step % 60 == 5:
            others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
        actions = {agent: seek(observations[agent][None, :1540])[0] for agent in env.agents}
        found = env.step(actions)
        for other in others if step >= 5 else []:
            same(other.step(actions), found)
            assert other.agents == env.agents
        observations = found[0]
        n_left += sum(found[2].values())
        if not env.agents:
            break
    assert n_left == 4 and step > 70
    for other in [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]:
        same((other.render(), other.reset()), (env.render(), copy.deepcopy(env).reset()))


def test_information_tells_where_robots_are_and_how_they_ended() -> None:
    env = jostle.parallel_env(3, settings={"sim.laser.noise_std": 0.0})
    ends = set()
    for seed in range(4):
        observations, infos = env.reset(seed=seed)
        least = {agent: infos[agent]["clearance"] for agent in env.agents}
        while env.agents:
            observations, _, terminated, truncated, infos = env.step({agent: seek(observations[agent][None])[0] for agent in env.agents})
            for agent, info in infos.items():
                x, y, heading = map(float, info["pose"])
                dx, dy = info["goal"] - (x, y)
                turned = [np.cos(heading) * dx + np.sin(heading) * dy, np.cos(heading) * dy - np.sin(heading) * dx]
                # Also where it ended: not where training would place it anew.
                np.testing.assert_allclose(observations[agent][1536:1538], turned, atol=1e-4)
                least[agent] = min(least[agent], info["clearance"])
                if terminated[agent] or truncated[agent]:
                    ends.add(info["outcome"])
                    assert info["min_clearance"] == least[agent]
                    assert info["time"] == pytest.approx(0.1 * info["steps"])
                    assert np.isfinite(info["extra_time"]) == (info["outcome"] == "success")
    assert len(ends) > 1


def test_an_image_has_every_robot_that_is_there() -> None:
    env = jostle.parallel_env(2, render_mode="rgb_array")
    with pytest.raises(ValueError, match="^render: found no episode, expected a reset before it$"):
        env.render()
    _, infos = env.reset(seed=0)
    image = env.render()
    for agent, colour in [("robot_0", (204, 51, 51)), ("robot_1", (34, 136, 51))]:
        x, y, heading = infos[agent]["pose"]
        x, y = x - 0.1 * np.cos(heading), y - 0.1 * np.sin(heading)
        assert tuple(image[int(4 + (10 - y) * 24), int(4 + (x + 10) * 24)]) == colour


def test_mistakes_are_one_line() -> None:
    with pytest.raises(ValueError, match="^n_behaviours: found 0, expected a whole number from 1 on$"):
        jostle.parallel_env(n_behaviours=0)
    with pytest.raises(ValueError, match="^n_behaviours: found 4294967296, expected a whole number from 1 to 4294967295$"):
        jostle.parallel_env(n_behaviours=2**32)
    with pytest.raises(ValueError, match="^n_agents: found 0, expected"):
        jostle.parallel_env(0)
