"""`PeerRoom`: episodes of the test for a robot that another simulator moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import jostle

ROOT = Path(__file__).parents[2]


def test_a_robot_that_moves_as_it_would_here_sees_the_same() -> None:
    env = jostle.RoomEnv("SF", n_pedestrians=6)
    room = jostle.PeerRoom("SF", n_pedestrians=6)
    row, info = env.reset(seed=5, options={"test_episode": 3})
    start = room.begin(3, seed=5)
    np.testing.assert_array_equal(start["pose"], info["pose"])
    np.testing.assert_array_equal(start["goal"], info["goal"])
    np.testing.assert_array_equal(start["pedestrians"], env.state()["pedestrians"])
    found = room.observe(info["pose"], (0, 0), env.state()["ranges"])
    np.testing.assert_array_equal(found, row)
    for step in range(40):
        action = np.array([0.6, 0.5 if step < 20 else -0.5], np.float32)
        row, _, terminated, truncated, info = env.step(action)
        room.walk()
        if terminated or truncated:
            assert step > 5
            break
        found = room.observe(info["pose"], action, env.state()["ranges"])
        np.testing.assert_array_equal(found, row)
        np.testing.assert_array_equal(room.pedestrians(), env.state()["pedestrians"])


def test_the_room_is_told_as_it_is() -> None:
    warehouse = ROOT / "maps" / "warehouse.toml"
    settings = {"sim.room.map": warehouse, "sim.spawn.goal_distance": 5.0}
    room = jostle.PeerRoom("SF", n_pedestrians=3, settings=settings, respawn_clearance=1.5)
    assert room.walls.tolist() == [[-6.5, -6.0], [6.5, 6.0]]
    assert [obstacle.kind for obstacle in room.obstacles] == ["box"] * 6 + ["circle"] * 2
    np.testing.assert_allclose(room.obstacles[5].numbers, [1.6, 5.4, 0.2, 1.2, 0.8], rtol=1e-6)
    np.testing.assert_allclose(room.obstacles[6].numbers, [-2.0, -5.3, 0.3], rtol=1e-6)
    assert (room.dt, room.step_limit, room.goal_radius, room.crash_range) == (0.1, 400, 0.5, 0.5)
    assert (room.limits, room.body, room.laser_range) == ((1.0, 1.0), (0.5, 0.5), 10.0)
    other = jostle.PeerRoom("SF", n_pedestrians=3, settings=settings, respawn_clearance=1.25)
    assert len(room.settings_hash) == 64 and room.settings_hash != other.settings_hash


def test_calls_out_of_turn_and_what_is_no_scan_are_refused_and_change_nothing() -> None:
    room = jostle.PeerRoom("SF", n_pedestrians=2)
    ranges = np.full(512, 10, np.float32)

    def refused(message: str, call: object, *arguments: object) -> None:
        assert callable(call)
        with pytest.raises(ValueError) as error:
            call(*arguments)
        assert str(error.value) == message

    refused("walk: found a call out of turn, expected begin next", room.walk)
    pose = room.begin(0)["pose"]
    refused("walk: found a call out of turn, expected observe next", room.walk)
    numbers = "512 numbers of at least 0, one a beam"
    refused(f"ranges: found 511 of them, expected {numbers}", room.observe, pose, (0, 0), ranges[1:])
    first = room.observe(pose, (0, 0), ranges)
    refused("observe: found a call out of turn, expected walk next", room.observe, pose, (0, 0), ranges)
    room.walk()
    refused(
        "robot: found pose (NaN, 0, 0) and velocity (0, 0), expected finite numbers",
        room.observe,
        (np.nan, 0, 0),
        (0, 0),
        ranges,
    )
    refused("episode: found -1, expected a whole number from 0 on", room.begin, -1)
    room.observe(pose, (0, 0), ranges)
    room.begin(0)
    np.testing.assert_array_equal(room.observe(pose, (0, 0), ranges), first)
    with pytest.raises(ValueError, match="sim.robot.dynamics: found rapier, expected kinematic"):
        jostle.PeerRoom("SF", settings={"sim.robot.dynamics": "rapier"})
