"""`parallel_env` by PettingZoo's own tests, and what it promises beyond them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from conftest import seek
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


def test_mistakes_are_one_line() -> None:
    env = jostle.parallel_env(2)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="^actions: found none for robot_1, expected one for each of robot_0, robot_1$"):
        env.step({"robot_0": [0.0, 0.0]})
    with pytest.raises(ValueError, match=r"^actions: found \(NaN, 0\) for robot 1, expected finite numbers$"):
        env.step({"robot_0": [0.0, 0.0], "robot_1": [np.nan, 0.0]})
    with pytest.raises(ValueError, match="^n_behaviours: found 0, expected a whole number from 1 on$"):
        jostle.parallel_env(n_behaviours=0)
    with pytest.raises(ValueError, match="^n_agents: found 0, expected"):
        jostle.parallel_env(0)
