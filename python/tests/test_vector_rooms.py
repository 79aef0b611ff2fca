"""`VectorRooms`: the same rooms as one by one, Gymnasium's rules for vectors, and no copies."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
import tracemalloc
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from conftest import WRONG_SEEDS, same, seek
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import jostle


@pytest.mark.parametrize("crowd", ["VA", "VO", "SF"])
def test_it_is_gymnasiums_own_vector_of_rooms(crowd: str, pool: Path) -> None:
    ours = jostle.VectorRooms(3, crowd, pool=pool)
    rooms = [lambda: jostle.RoomEnv(crowd, pool=pool)] * 3
    theirs = SyncVectorEnv(rooms, autoreset_mode=AutoresetMode.SAME_STEP)
    assert ours.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    (a, info_a), (b, info_b) = ours.reset(seed=5), theirs.reset(seed=5)
    ended = 0
    for _ in range(300):
        np.testing.assert_array_equal(a, b)
        assert info_a.keys() == info_b.keys()
        for key in ("pose", "goal", "clearance", "_pose", "_goal", "_clearance"):
            same(info_a[key], info_b[key])
        if "final_info" in info_a:
            ended += info_a["_final_obs"].sum()
            np.testing.assert_array_equal(info_a["_final_obs"], info_b["_final_obs"])
            for i in np.flatnonzero(info_a["_final_obs"]):
                np.testing.assert_array_equal(info_a["final_obs"][i], info_b["final_obs"][i])
            assert info_a["final_info"].keys() == info_b["final_info"].keys()
            for key, values in info_a["final_info"].items():
                np.testing.assert_array_equal(values, info_b["final_info"][key])
        a, *ends_a, info_a = ours.step(seek(a))
        b, *ends_b, info_b = theirs.step(seek(b))
        for found, expected in zip(ends_a, ends_b, strict=True):
            assert found.dtype == expected.dtype
            np.testing.assert_array_equal(found, expected)
    assert ended >= 3


def test_gymnasiums_makers_and_wrappers_take_it() -> None:
    env = gymnasium.make_vec("jostle/Room-v0", num_envs=4, vectorization_mode="vector_entry_point", crowd="SF")
    env = RecordEpisodeStatistics(env)
    observations, _ = env.reset(seed=0)
    lengths: list[int] = []
    while len(lengths) < 8:
        observations, _, terminated, truncated, infos = env.step(seek(observations))
        if (terminated | truncated).any():
            episode = infos["episode"]
            np.testing.assert_array_equal(episode["l"] > 0, terminated | truncated)
            np.testing.assert_array_equal(infos["final_info"]["steps"], episode["l"])
            lengths += episode["l"][episode["l"] > 0].tolist()


def test_seeds_may_be_given_one_by_one_and_rooms_reset_by_a_mask() -> None:
    env = jostle.VectorRooms(3, "SF")
    observations, _ = env.reset(seed=[4, 4, 9])
    assert np.array_equal(observations[0], observations[1]) and not np.array_equal(observations[0], observations[2])
    held = observations.copy()
    again, _ = env.reset(seed=[None, 9, None], options={"reset_mask": np.array([False, True, True])})
    np.testing.assert_array_equal(again[:2], held[[0, 2]])
    assert not np.array_equal(again[2], held[2])
    np.testing.assert_array_equal(observations, held, err_msg="what a caller holds is not written to")
    for seed, message in [([1], "seed: found 1 seeds, expected 3, one for each room"), ([-1, 0, 0], "seed: found -1")]:
        with pytest.raises(ValueError, match=message):
            env.reset(seed=seed)
    with pytest.raises(ValueError, match=r"reset_mask: found int64\(2,\), expected bool\(3,\)"):
        env.reset(options={"reset_mask": np.zeros(2, np.int64)})


def test_rows_of_a_refused_step_are_as_before_after_a_partial_reset() -> None:
    """What a refused step left unwritten must not come out of the next reset."""
    refused, undisturbed = jostle.VectorRooms(3, "SF"), jostle.VectorRooms(3, "SF")
    for env in (refused, undisturbed):
        env.reset(seed=6)
        env.step(np.ones((3, 2)))
    wrong = [
        (None, "actions: found None, expected numbers of shape (3, 2)"),
        (np.ones((2, 2)), "actions: found shape (2, 2), expected (3, 2)"),
        (np.ones((3, 2), object), "actions: found array([[1, 1], [1, 1], [1, 1]], dtype=object), expected numbers of shape (3, 2)"),
        (np.full((3, 2), np.inf), "actions: found (inf, inf) for room 0, expected finite numbers"),
        ([[0, 0], [0, np.nan], [0, 0]], "actions: found (0, NaN) for room 1, expected finite numbers"),
    ]
    for actions, message in wrong:
        with pytest.raises(ValueError) as error:
            refused.step(actions)
        assert str(error.value) == message
        mask = {"options": {"reset_mask": np.array([False, True, False])}}
        same(refused.reset(**mask), undisturbed.reset(**mask))
        same(refused.step(np.ones((3, 2))), undisturbed.step(np.ones((3, 2))))


def test_a_refused_reset_changes_nothing() -> None:
    env, undisturbed = jostle.VectorRooms(3, "SF"), jostle.VectorRooms(3, "SF")
    with pytest.raises(ValueError, match="^step: found no episode in room 0, expected a reset before it$"):
        env.step(np.zeros((3, 2)))
    same(env.reset(seed=3), undisturbed.reset(seed=3))
    wrong = [({"seed": seed}, message) for seed, message in WRONG_SEEDS if seed != "3" and seed != 1.5]
    wrong += [({"seed": [5, seed, 7]}, message) for seed, message in WRONG_SEEDS]
    wrong += [
        ({"seed": "345"}, "seed: found '345', expected a whole number, or 3 of them, one for each room"),
        ({"seed": 2**63 - 2}, f"seed: found {2**63}, expected a whole number from 0 to {2**63 - 1}"),
        ({"options": {"test_episode": 3}}, "options: found 'test_episode', expected reset_mask alone"),
        ({"options": {"reset_mask": [True] * 3}}, "reset_mask: found [True, True, True], expected an array bool(3,)"),
        ({"seed": 1, "options": {"mask": 3}}, "options: found 'mask', expected reset_mask alone"),
    ]
    for keywords, message in wrong:
        with pytest.raises(ValueError) as error:
            env.reset(**keywords)
        assert str(error.value) == message
        same(env.step(np.ones((3, 2))), undisturbed.step(np.ones((3, 2))))
    same(env.reset(), undisturbed.reset())
    partly = jostle.VectorRooms(2, "SF", render_mode="rgb_array")
    partly.reset(seed=1, options={"reset_mask": np.array([True, False])})
    for what, call in [("step", lambda: partly.step(np.zeros((2, 2)))), ("state", lambda: partly.state(1)), ("render", partly.render)]:
        with pytest.raises(ValueError, match=f"^{what}: found no episode in room 1, expected a reset before it$"):
            call()
    with pytest.raises(ValueError, match="^room: found 2, expected a whole number below 2$"):
        partly.state(2)


@pytest.mark.parametrize(("crowd", "copies"), [("NH", True), ("SF", True), ("SF", False)])
def test_copies_and_pickles_go_on_bit_for_bit(crowd: str, copies: bool, pool: Path) -> None:
    env = jostle.VectorRooms(3, crowd, pool=pool, copy=copies, render_mode="rgb_array")
    observations, _ = env.reset(seed=8)
    ended = 0
    for step in range(150):
        if step % 70 == 20:
            others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
        actions = seek(observations)
        found = env.step(actions)
        ended += "final_info" in found[-1]
        if step >= 20:
            for other in others:
                same(other.step(actions), found)
        observations = found[0]
    assert ended > 0
    for other in others:
        same(other.reset(options={"reset_mask": np.array([True, False, True])}), copy.deepcopy(env).reset(options={"reset_mask": np.array([True, False, True])}))
    same(copy.deepcopy(env).render(), env.render())


def test_images_are_those_of_the_rooms() -> None:
    env = gymnasium.make_vec("jostle/Room-v0", num_envs=2, vectorization_mode="vector_entry_point", render_mode="rgb_array")
    env.reset(seed=5)
    images = env.render()
    for i in range(2):
        room = jostle.RoomEnv("SF", render_mode="rgb_array")
        room.reset(seed=5 + i)
        np.testing.assert_array_equal(images[i], room.render())


def test_rust_writes_into_pythons_arrays_and_nothing_is_copied() -> None:
    n, steps = 64, 20
    row = 1540 * 4
    actions = np.zeros((n, 2), np.float32)

    def most_memory(env: jostle.VectorRooms) -> int:
        env.reset(seed=0)
        env.step(actions)
        tracemalloc.start()
        try:
            for _ in range(steps):
                *_, terminated, _, _ = env.step(actions)
                assert not terminated.any()
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    settings = {"sim.room.width": 200.0, "sim.room.height": 200.0}
    shared = jostle.VectorRooms(n, "SF", settings=settings, copy=False)
    # Nothing of the size of even one row, where a batch has 64.
    assert most_memory(shared) < row
    first, second = shared.step(actions)[0], shared.step(actions)[0]
    assert first is second
    # Each step its own array: the one being written and the one before.
    assert n * row <= most_memory(jostle.VectorRooms(n, "SF", settings=settings)) < 2.1 * n * row


def test_steps_do_not_touch_what_a_caller_holds() -> None:
    env = jostle.VectorRooms(2, "VO")
    held, _ = env.reset(seed=0)
    copy = held.copy()
    held_2 = env.step(np.ones((2, 2)))[0]
    copy_2 = held_2.copy()
    env.step(np.ones((2, 2)))
    np.testing.assert_array_equal(held, copy)
    np.testing.assert_array_equal(held_2, copy_2)
    # Nor does scribbling over an observation reach the simulator.
    other = jostle.VectorRooms(2, "VO", copy=False)
    other.reset(seed=0)[0][:] = 99.0
    other.step(np.ones((2, 2)))[0][:] = 99.0
    np.testing.assert_array_equal(env.step(np.ones((2, 2)))[0], (other.step(np.ones((2, 2))), other.step(np.ones((2, 2))))[1][0])


def test_any_number_of_threads_gives_the_same_bytes() -> None:
    script = (
        "import sys, hashlib, jostle; sys.path.insert(0, sys.argv[1]); from conftest import seek\n"
        "hash_ = hashlib.sha256(); env = jostle.VectorRooms(8, 'VO'); o, _ = env.reset(seed=0)\n"
        "for _ in range(200):\n"
        "    o, r, t, u, _ = env.step(seek(o)); [hash_.update(x.tobytes()) for x in (o, r, t, u)]\n"
        "print(hash_.hexdigest())"
    )
    hashes = [
        subprocess.run(
            [sys.executable, "-c", script, str(Path(__file__).parent)],
            env={**os.environ, "RAYON_NUM_THREADS": str(threads)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in (1, 2, 8)
    ]
    assert len(hashes[0].strip()) == 64
    assert hashes[0] == hashes[1] == hashes[2]
