"""`RoomEnv` by Gymnasium's own checks, and what it promises beyond them."""

from __future__ import annotations

import copy
import hashlib
import multiprocessing
import pickle
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from conftest import WRONG_SEEDS, seek, same
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
            assert set(info) == {"pose", "goal", "clearance"}
            state = env.state()
            np.testing.assert_array_equal(info["pose"], state["robot"][:3])
            np.testing.assert_array_equal(info["goal"], state["robot"][5:])
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
        ({"crowd": "NH", "pool": "/nonexistent"}, "/nonexistent: found no such file or folder, expected a checkpoint file or a run"),
        ({"crowd": 3}, "crowd: found 3, expected one of"),
        ({"robot_visible": 2}, "robot_visible: found 2, expected True, False or None"),
        ({"n_pedestrians": 2.5}, "n_pedestrians: found 2.5, expected a whole number from 0 on"),
        ({"n_pedestrians": True}, "n_pedestrians: found True, expected a whole number"),
        ({"pool": 3}, "pool: found 3, expected a path or several"),
        ({"pool_half": [3]}, "pool_half: found [3], expected a path or several"),
        ({"config": 3}, "config: found 3, expected a path"),
        ({"settings": 3}, "settings: found 3, expected a dictionary"),
        ({"render_mode": "human"}, "render_mode: found 'human', expected rgb_array or None"),
    ],
)
def test_mistakes_are_one_line(keywords: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.RoomEnv(**keywords)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


WRONG_ACTIONS = [
    (None, "actions: found None, expected numbers of shape (2,)"),
    ("left", "actions: found 'left', expected numbers of shape (2,)"),
    ([None, 0.0], "actions: found [None, 0.0], expected numbers of shape (2,)"),
    ([[0.0], [0.0, 1.0]], "actions: found [[0.0], [0.0, 1.0]], expected numbers of shape (2,)"),
    ([1j, 0.0], "actions: found [1j, 0.0], expected numbers of shape (2,)"),
    ({"v": 1.0}, "actions: found {'v': 1.0}, expected numbers of shape (2,)"),
    (0.5, "actions: found shape (), expected (2,)"),
    ([1.0, 0.0, 0.0], "actions: found shape (3,), expected (2,)"),
    ([[1.0, 0.0]], "actions: found shape (1, 2), expected (2,)"),
    ([np.nan, 0.0], "actions: found (NaN, 0) for room 0, expected finite numbers"),
    ([0.0, -np.inf], "actions: found (0, -inf) for room 0, expected finite numbers"),
    ([1e300, 0.0], "actions: found (inf, 0) for room 0, expected finite numbers"),
]


@pytest.mark.parametrize("copies", [True, False])
def test_a_refused_step_changes_nothing(copies: bool) -> None:
    refused, undisturbed = jostle.RoomEnv("SF", copy=copies), jostle.RoomEnv("SF", copy=copies)
    observation, info = refused.reset(seed=0)
    same((observation, info), undisturbed.reset(seed=0))
    for action, message in WRONG_ACTIONS:
        before = refused.state()
        with pytest.raises(ValueError) as error:
            refused.step(action)
        assert str(error.value) == message
        same(refused.state(), before)
        action = seek(observation[None])[0]
        found = refused.step(action)
        same(found, undisturbed.step(action))
        observation = found[0]


def test_what_needs_an_episode_is_refused_before_one() -> None:
    env = jostle.RoomEnv("SF", render_mode="rgb_array")
    for what, call in [("step", lambda: env.step([0.0, 0.0])), ("state", env.state), ("render", env.render)]:
        with pytest.raises(ValueError, match=f"^{what}: found no episode in room 0, expected a reset before it$"):
            call()


def test_a_refused_reset_changes_nothing() -> None:
    env, undisturbed = jostle.RoomEnv("SF"), jostle.RoomEnv("SF")
    same(env.reset(seed=3), undisturbed.reset(seed=3))
    wrong = [({"seed": seed}, message) for seed, message in WRONG_SEEDS]
    wrong += [
        ({"options": 3}, "options: found 3, expected a dictionary or None"),
        ({"options": {"test_episodes": 1}}, "options: found 'test_episodes', expected test_episode alone"),
        ({"options": {"reset_mask": np.array([True])}}, "options: found 'reset_mask', expected test_episode alone"),
        ({"options": {"test_episode": -1}}, "test_episode: found -1, expected a whole number from 0 on"),
        ({"options": {"test_episode": "x"}}, "test_episode: found 'x', expected a whole number from 0 on"),
        ({"seed": 1, "options": {"test_episode": 1.5}}, "test_episode: found 1.5, expected a whole number from 0 on"),
    ]
    for keywords, message in wrong:
        with pytest.raises(ValueError) as error:
            env.reset(**keywords)
        assert str(error.value) == message
        same(env.step([1.0, 0.0]), undisturbed.step([1.0, 0.0]))
    # Nor is the source of the next seeds moved.
    same(env.reset(), undisturbed.reset())
    assert env.np_random.random() == undisturbed.np_random.random()
    same(env.reset(seed=2**63 - 1), undisturbed.reset(seed=np.uint64(2**63 - 1)))
    env.reset(seed=None, options={})


def copies_of(env: object) -> list[object]:
    """The two ways to a copy."""
    return [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]


@pytest.mark.parametrize("crowd", ["VA", "VO", "SF", "stop-and-go"])
def test_copies_and_pickles_go_on_bit_for_bit(crowd: str, pool: Path) -> None:
    env = jostle.RoomEnv(crowd, pool=pool, render_mode="rgb_array")
    for other in copies_of(env):
        same(other.reset(seed=4), env.reset(seed=4))
    observation, _ = env.reset(seed=4)
    ends = 0
    for step in range(260):
        if step % 65 == 0:
            copies = copies_of(env)
        action = seek(observation[None])[0]
        found = env.step(action)
        for other in copies:
            same(other.step(action), found)
        observation, _, terminated, truncated, _ = found
        if terminated or truncated:
            ends += 1
            for other in copies_of(env):
                with pytest.raises(ValueError, match="found an ended episode"):
                    other.step(action)
            found = env.reset()
            for other in copies:
                same(other.reset(), found)
            observation = found[0]
    assert ends > 0
    for other in copies:
        same((other.state(), other.render()), (env.state(), env.render()))
        # Copies are apart: the one that goes on does not move the other.
        before = env.state()
        other.step([1.0, 0.5])
        same(env.state(), before)


def test_a_copy_of_an_episode_of_the_test_goes_on_in_it() -> None:
    env = jostle.RoomEnv("SF")
    env.reset(seed=2, options={"test_episode": 5})
    env.step([1.0, 0.0])
    for other in copies_of(env):
        assert other.state()["episode_index"] == 5
        same(other.step([1.0, 0.1]), copy.deepcopy(env).step([1.0, 0.1]))


def test_a_pickle_of_other_settings_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("[sim.laser]\nbeams = 32\n")
    env = jostle.RoomEnv("SF", config=file)
    env.reset(seed=0)
    written = pickle.dumps(env)
    same(pickle.loads(written).state(), env.state())
    file.write_text("[sim.laser]\nbeams = 64\n")
    with pytest.raises(ValueError, match="^snapshot: found other settings, map or policies, expected those of these rooms"):
        pickle.loads(written)


def test_the_last_information_holds_outcome_and_measures_as_the_test_does() -> None:
    found = jostle.evaluate(seek, "SF", episodes=6, seed=5)
    env = jostle.RoomEnv("SF")
    outcomes = set()
    for record in found.records:
        observation, info = env.reset(seed=5, options={"test_episode": record["episode"]})
        clearances = [info["clearance"]]
        while "outcome" not in info:
            observation, *_, info = env.step(seek(observation[None])[0])
            clearances.append(info["clearance"])
        outcomes.add(info["outcome"])
        for key in ("outcome", "steps", "time", "path_length", "straight_distance"):
            assert info[key] == record[key]
        for key in ("extra_time", "extra_distance", "average_speed"):
            expected = np.nan if record[key] is None else record[key]
            np.testing.assert_equal(info[key], expected)
        assert info["min_clearance"] == min(clearances)
        np.testing.assert_array_equal(info["goal"], np.array(record["goal"], np.float32))
    assert "success" in outcomes and len(outcomes) > 1


def test_clearance_is_the_distance_between_outlines() -> None:
    env = jostle.RoomEnv("SF", n_pedestrians=0)
    for seed in range(5):
        _, info = env.reset(seed=seed)
        x, y, heading = map(float, info["pose"])
        half = 0.25 * (abs(np.cos(heading)) + abs(np.sin(heading)))
        assert info["clearance"] == pytest.approx(min(10 - abs(x), 10 - abs(y)) - half, abs=1e-5)
    # With one pedestrian it is at most the distance of the centres, and at least that less both circumradii.
    env = jostle.RoomEnv("SF", n_pedestrians=1, settings={"sim.room.width": 200.0, "sim.room.height": 200.0})
    for seed in range(5):
        _, info = env.reset(seed=seed)
        between = np.hypot(*(env.state()["pedestrians"][0, :2] - info["pose"][:2]))
        to_wall = 100 - np.abs(info["pose"][:2]).max()
        if between < to_wall:
            assert between - 0.5 * 2**0.5 - 1e-4 <= info["clearance"] <= between - 0.5 + 1e-4


def test_an_image_shows_the_robot_where_it_is() -> None:
    env = jostle.RoomEnv("VO", render_mode="rgb_array")
    env.reset(seed=1)
    images = []
    for _ in range(3):
        image = env.render()
        assert image.dtype == np.uint8 and image.shape == (488, 488, 3) and image.flags.writeable
        state = env.state()
        for body, colour in [(state["robot"], (204, 51, 51)), *((p, (68, 119, 170)) for p in state["pedestrians"])]:
            # A little behind the middle, beside the line of the nose.
            x, y = body[:2] - 0.1 * np.array([np.cos(body[2]), np.sin(body[2])])
            assert tuple(image[int(4 + (10 - y) * 24), int(4 + (x + 10) * 24)]) == colour
        images.append(image)
        for _ in range(10):
            env.step([1.0, 0.3])
    assert not np.array_equal(images[0], images[1])
    assert env.metadata["render_fps"] == 10
    with pytest.warns(UserWarning, match="no render_mode was given"):
        assert jostle.RoomEnv("VO").render() is None
    made = gymnasium.make("jostle/Room-v0", crowd="VO", render_mode="rgb_array")
    made.reset(seed=1)
    np.testing.assert_array_equal(made.render(), images[0])


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
