"""`RoomEnv` by Gymnasium's own checks, and what it promises beyond them."""

from __future__ import annotations

import hashlib
import multiprocessing
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from conftest import seek
from gymnasium.utils.env_checker import check_env

import jostle


def drive(env: gymnasium.Env, steps: int, **reset: object) -> bytes:
    """A hash of everything that an environment says in some episodes."""
    hash_ = hashlib.sha256()
    observation, info = env.reset(**reset)
    for _ in range(steps):
        hash_.update(observation.tobytes() + repr(info).encode())
        observation, reward, terminated, truncated, info = env.step(seek(observation[None])[0])
        hash_.update(repr((reward, terminated, truncated)).encode())
        if terminated or truncated:
            hash_.update(observation.tobytes())
            observation, info = env.reset()
    return hash_.digest()


@pytest.mark.parametrize("crowd", jostle.CROWDS + jostle.VALIDATION_CROWDS)
def test_gymnasiums_checker_has_nothing_to_say(crowd: str, pool: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make("jostle/Room-v0", crowd=crowd, pool=pool)
        check_env(env.unwrapped)
    assert env.unwrapped.observation_space.shape == (1540,)


@pytest.mark.parametrize("crowd", ["NH", "VA", "VO", "SF"])
def test_the_same_seed_gives_the_same_bytes(crowd: str, pool: Path) -> None:
    hashes = [drive(jostle.RoomEnv(crowd, pool=pool), 300, seed=seed) for seed in (7, 7, 8)]
    assert hashes[0] == hashes[1] != hashes[2]
    used = jostle.RoomEnv(crowd, pool=pool)
    drive(used, 50, seed=1)
    assert drive(used, 300, seed=7) == hashes[0]


def test_without_a_seed_no_two_environments_are_alike() -> None:
    assert len({drive(jostle.RoomEnv("SF"), 3) for _ in range(4)}) == 4


def test_episodes_follow_each_other_and_end_with_an_outcome() -> None:
    env = jostle.RoomEnv("SF")
    seen = set()
    observation, _ = env.reset(seed=0)
    for episode in range(12):
        total = 0.0
        while True:
            start = np.hypot(*observation[-4:-2])
            observation, reward, terminated, truncated, info = env.step(seek(observation[None])[0])
            assert env.observation_space.contains(observation)
            total += reward
            if terminated or truncated:
                break
            assert info == {}
        assert info["episode_index"] == episode
        assert info["is_success"] == (info["outcome"] == "success") == (np.hypot(*observation[-4:-2]) < 0.5)
        assert truncated == (info["outcome"] == "timeout")
        if info["outcome"].startswith("collision"):
            assert reward <= -15.0
        assert info["path_length"] <= 0.1 * info["steps"] + 1e-9
        with pytest.raises(ValueError, match="step: found an ended episode in room 0, expected a reset before it"):
            env.step(np.zeros(2))
        seen.add(info["outcome"])
        observation, _ = env.reset()
        assert np.hypot(*observation[-4:-2]) > 10.0 - 1e-3 and start < 20 * 2**0.5
    assert {"success", "collision_pedestrian"} <= seen


def test_settings_reach_the_simulator() -> None:
    env = jostle.RoomEnv("VO", n_pedestrians=2, settings={"sim.laser.beams": 64, "sim.laser.noise_std": 0.0})
    observation, _ = env.reset(seed=0)
    scans, goal, velocity = jostle.split(observation)
    assert (scans.shape, goal.shape, velocity.tolist()) == ((3, 64), (2,), [0.0, 0.0])
    assert np.shares_memory(scans, observation)
    state = env.state()
    assert state["pedestrians"].shape == (2, 7)
    # Without noise the observation is the scan itself.
    np.testing.assert_array_equal(scans[2], state["ranges"] / np.float32(10) - np.float32(0.5))
    x, y, heading = state["robot"][:3]
    dx, dy = state["robot"][5:] - (x, y)
    turned = [np.cos(heading) * dx + np.sin(heading) * dy, np.cos(heading) * dy - np.sin(heading) * dx]
    np.testing.assert_allclose(goal, turned, atol=1e-4)


def test_a_training_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("n_agents = 3\n[sim.laser]\nbeams = 32\n")
    env = jostle.RoomEnv("SF", config=file)
    assert env.observation_space.shape == (3 * 32 + 4,)
    env.reset(seed=0)
    assert len(env.state()["pedestrians"]) == 2


def test_pedestrians_may_see_the_robot() -> None:
    """Those who see a robot that stands in their way walk another way than those who do not."""
    differs = 0
    for seed in range(6):
        places = []
        for visible in (False, True, None):
            env = jostle.RoomEnv("VO", robot_visible=visible)
            env.reset(seed=seed)
            for _ in range(80):
                if env.step(np.zeros(2))[2]:
                    break
            places.append(env.state()["pedestrians"])
        np.testing.assert_array_equal(places[0], places[2])
        differs += not np.array_equal(places[0], places[1])
    assert differs > 0


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"crowd": "XX"}, "unknown crowd `XX`; expected one of NH, IN, VA, SO, VO, SF"),
        ({"crowd": "straight", "robot_visible": True}, "robot_visible: found true for crowd straight, expected nothing"),
        ({"crowd": "NH"}, "crowd NH needs a pool of pedestrian policies; found none"),
        ({"settings": {"sim.laser.beam": 3}}, "settings: sim.laser.beam=3: sim.laser.beam: found an unknown key, expected beams"),
        ({"settings": {"sim.laser.noise_std": -1.0}}, "settings: sim.laser.noise_std=-1.0: sim.laser.noise_std: found -1"),
        ({"settings": {"sim.laser.beams": []}}, "settings: sim.laser.beams: found [], expected a bool, a number or a text"),
        ({"config": "/nonexistent/a.toml"}, "/nonexistent/a.toml: cannot read"),
        ({"n_pedestrians": -1}, "n_pedestrians: found -1, expected a whole number from 0 on"),
        ({"n_pedestrians": 900}, "n_agents: found 901, expected so few that their spawn clearances"),
        ({"crowd": "NH", "pool": "/nonexistent"}, "/nonexistent: cannot open"),
    ],
)
def test_mistakes_are_one_line(keywords: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.RoomEnv(**keywords)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_bad_actions_move_nothing() -> None:
    env = jostle.RoomEnv("SF")
    env.reset(seed=0)
    before = env.state()
    for action, message in [
        ([np.nan, 0.0], "actions: found (NaN, 0) for room 0, expected finite numbers"),
        ([1.0, 0.0, 0.0], "actions: found shape [1, 3], expected rows of 2"),
    ]:
        with pytest.raises(ValueError) as error:
            env.step(action)
        assert str(error.value) == message
    np.testing.assert_array_equal(env.state()["pedestrians"], before["pedestrians"])


def _one_step(crowd: str, pool: Path | None, queue: multiprocessing.SimpleQueue) -> None:
    try:
        env = jostle.RoomEnv(crowd, pool=pool)
        env.reset(seed=0)
        env.step(np.zeros(2))
        queue.put("stepped")
    except RuntimeError as error:
        queue.put(str(error))


@pytest.mark.parametrize(("crowd", "answer"), [("SF", "stepped"), ("NH", "lost its threads")])
def test_a_fork_steps_or_says_why_not(crowd: str, answer: str, pool: Path) -> None:
    drive(jostle.RoomEnv("NH", pool=pool), 3, seed=0)
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    child = context.Process(target=_one_step, args=(crowd, pool, queue))
    child.start()
    child.join(timeout=60)
    assert child.exitcode == 0
    assert answer in queue.get()
