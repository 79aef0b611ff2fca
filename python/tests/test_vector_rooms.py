"""`VectorRooms`: the same rooms as one by one, Gymnasium's rules for vectors, and no copies."""

from __future__ import annotations

import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from conftest import seek
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
        if info_a:
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
