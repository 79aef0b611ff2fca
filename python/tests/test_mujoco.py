"""The driver of Table 5 in MuJoCo: `crates/bench/peers/mujoco_driver.py`."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import jostle

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco==4.0.0")

ROOT = Path(__file__).parents[2]
DRIVER = ROOT / "crates" / "bench" / "peers" / "mujoco_driver.py"


@pytest.fixture(scope="module")
def driver() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mujoco_driver", DRIVER)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mujoco_driver"] = module
    spec.loader.exec_module(module)
    return module


def settings(map_name: str | None = None) -> dict[str, object]:
    keys: dict[str, object] = {"sim.robot.length": 0.508, "sim.robot.width": 0.43}
    if map_name is not None:
        keys |= {"sim.room.map": ROOT / "maps" / f"{map_name}.toml", "sim.spawn.goal_distance": 5.0}
    return keys


def peer(n_pedestrians: int, map_name: str | None = None) -> jostle.PeerRoom:
    room = jostle.PeerRoom("SF", n_pedestrians=n_pedestrians, settings=settings(map_name), respawn_clearance=1.5)
    return room


def test_a_straight_run_is_the_kinematic_one_but_for_the_start(driver: ModuleType) -> None:
    room, env = peer(0), jostle.RoomEnv("SF", n_pedestrians=0, settings=settings())
    world = driver.world_of(room, 0)
    nobody = np.zeros((0, 7))
    runs = 0
    for episode in range(8):
        _, info = env.reset(seed=0, options={"test_episode": episode})
        if env.state()["ranges"][0] < 5:
            continue
        runs += 1
        start = room.begin(episode)["pose"].astype(float)
        world.place(start, nobody)
        for step in range(30):
            info = env.step([1, 0])[-1]
            world.drive((float(step > 0), 0), (1, 0), room.dt, nobody, nobody)
        x, y, heading = world.pose()
        ahead = np.array([np.cos(start[2]), np.sin(start[2])])
        behind = info["pose"][:2] - [x, y]
        assert behind @ ahead == pytest.approx(slide(driver), abs=0.005)
        assert abs(behind @ [-ahead[1], ahead[0]]) < 0.01
        assert abs(heading - start[2]) < 0.01
        v, w = world.velocity()
        assert abs(v - 1) < 0.005 and abs(w) < 0.005
    assert runs >= 3


def slide(driver: ModuleType) -> float:
    """What a start to 1 m/s costs and a stop from it takes (m): the wheels' grip, and the command's delay."""
    return float(1 / (2 * driver.FRICTION * 9.81) + driver.LATENCY)


def turn_rate(driver: ModuleType) -> float:
    """What a robot that is told to turn on the spot at 1 rad/s does (rad/s), its start left out."""
    world = driver.world_of(peer(0), 0)
    nobody = np.zeros((0, 7))
    world.place(np.zeros(3), nobody)
    turned = []
    for step in range(40):
        heading = world.pose()[2]
        world.drive((0, float(step > 0)), (0, 1), 0.1, nobody, nobody)
        turned.append(float(np.remainder(world.pose()[2] - heading + np.pi, 2 * np.pi) - np.pi))
    return float(np.mean(turned[10:]) / 0.1)


def start_and_stop(driver: ModuleType) -> tuple[float, float]:
    """How far a robot falls behind that starts to 1 m/s, and how far it goes on when it is told to stop (m)."""
    world = driver.world_of(peer(0), 0)
    nobody = np.zeros((0, 7))
    world.place(np.array([-9.0, 0, 0]), nobody)
    for step in range(30):
        world.drive((float(step > 0), 0), (1, 0), 0.1, nobody, nobody)
    x = world.pose()[0]
    for step in range(10):
        world.drive((float(step == 0), 0), (0, 0), 0.1, nobody, nobody)
    return float(3 - (x + 9)), float(world.pose()[0] - x)


def test_turns_starts_and_stops_are_the_closed_forms(driver: ModuleType) -> None:
    assert turn_rate(driver) == pytest.approx(closed_turn(driver), rel=0.05)
    assert start_and_stop(driver) == pytest.approx((slide(driver),) * 2, rel=0.05)


def closed_turn(driver: ModuleType) -> float:
    """Four wheels that slide: docs/how-to-dynamics.md."""
    track, base = (driver.TRACK / 2) ** 2, (driver.WHEELBASE / 2) ** 2
    return float(driver.TURN_GAIN * track / (track + base))


@pytest.mark.parametrize(
    ("rotor", "substep", "turn", "start", "stop"),
    [
        (0.0, 0.005, 0.26, 0.25, 0.32),
        (0.0, 0.001, 0.53, 0.15, 0.15),
        (0.0, 0.0002, 0.73, 0.13, 0.12),
        (0.1, 0.005, 0.96, 0.12, 0.12),
        (0.1, 0.001, 0.98, 0.12, 0.12),
        (0.1, 0.0002, 0.99, 0.12, 0.12),
        (0.5, 0.005, 1.01, 0.14, 0.14),
        (0.5, 0.001, 1.03, 0.14, 0.14),
    ],
)
def test_what_rotors_and_substeps_do(
    driver: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    rotor: float,
    substep: float,
    turn: float,
    start: float,
    stop: float,
) -> None:
    """The table in docs/how-to-dynamics.md: without rotors the substep decides, and with them it does not."""
    monkeypatch.setattr(driver, "ROTOR", rotor)
    monkeypatch.setattr(driver, "SUBSTEP", substep)
    assert turn_rate(driver) == pytest.approx(turn, abs=0.02)
    assert start_and_stop(driver) == pytest.approx((start, stop), abs=0.01)


@pytest.mark.parametrize("map_name", [None, "warehouse", "hospital"])
def test_both_lasers_measure_the_same(driver: ModuleType, map_name: str | None) -> None:
    """Of 512 beams three may graze a corner on one side only."""
    n = 0 if map_name is None else 4
    env = jostle.RoomEnv("SF", n_pedestrians=n, settings=settings(map_name))
    room = peer(n, map_name)
    world = driver.world_of(room, n)
    for episode in range(5):
        start = room.begin(episode)
        # The crowd's first places are the same in both rooms.
        env.reset(seed=0, options={"test_episode": episode})
        world.place(start["pose"].astype(float), start["pedestrians"].astype(float))
        difference = np.abs(world.scan(room.laser_range) - env.state()["ranges"])
        assert np.sort(difference)[-4] < 0.002, difference.max()


def test_a_pedestrian_who_walks_into_the_robot_is_a_collision(driver: ModuleType) -> None:
    room = peer(1)
    world = driver.world_of(room, 1)
    outcome, people = None, np.array([[2.0, 0.1, np.pi, 0, 0, 0, 0]])
    world.place(np.zeros(3), people)
    steps = 0
    while outcome is None and steps < 40:
        before, people = people, people - [0.1, 0, 0, 0, 0, 0, 0]
        world.drive((0, 0), (0, 0), room.dt, before, people)
        outcome, steps = world.crash(world.scan(room.laser_range), room.crash_range), steps + 1
    # Its front is 0.254 m ahead of its middle.
    assert (outcome, steps) == ("collision_pedestrian", 13)


def test_a_robot_that_drives_into_a_wall_is_a_collision(driver: ModuleType) -> None:
    room = peer(0)
    world = driver.world_of(room, 0)
    nobody = np.zeros((0, 7))
    world.place(np.array([8.0, 0, 0]), nobody)
    outcome = None
    for step in range(30):
        world.drive((float(step > 0), 0), (1, 0), room.dt, nobody, nobody)
        outcome = world.crash(world.scan(room.laser_range), room.crash_range)
        if outcome:
            break
    assert outcome == "collision_wall" and 9.45 < world.pose()[0] < 9.65


def test_episodes_are_the_same_again(driver: ModuleType) -> None:
    def run() -> list[dict[str, object]]:
        room = peer(5, "warehouse")
        dwa = jostle.planner("dwa", settings={key: value for key, value in settings("warehouse").items()})
        world = driver.world_of(room, 5)
        return [driver.episode(room, world, dwa, index) for index in (0, 1)]

    first = run()
    assert first == run()
    assert all(episode["path_length"] > 1 and episode["steps"] > 20 for episode in first)


def test_the_robot_is_the_one_of_the_settings(driver: ModuleType, xtask: Callable[..., str]) -> None:
    """The published constants are written twice, here and in Rust, and are the same."""
    told = xtask("config", "explain", "sim.robot.base")

    def default(key: str) -> float:
        found = re.search(rf"^\s*(?:sim\.robot\.base\.)?{key}\b.*?Default ([0-9.]+)", told, re.MULTILINE | re.DOTALL)
        assert found is not None, told
        return float(found[1].rstrip("."))

    mass = driver.CHASSIS_MASS + 4 * driver.WHEEL_MASS
    radius_sq = (driver.WHEELBASE**2 + driver.TRACK**2) / 4
    inertia = driver.CHASSIS_INERTIA[2] + 4 * (driver.WHEEL_MASS * radius_sq + driver.WHEEL_INERTIA[2])
    assert mass == pytest.approx(default("mass"), abs=1e-3)
    assert inertia == pytest.approx(default("inertia"), abs=1e-3)
    for key, value in {
        "wheelbase": driver.WHEELBASE,
        "track": driver.TRACK,
        "wheel_radius": driver.WHEEL_RADIUS,
        "friction": driver.FRICTION,
        "motor_torque": driver.MOTOR_TORQUE,
        "turn_gain": driver.TURN_GAIN,
        "latency": driver.LATENCY,
    }.items():
        assert value == default(key), key
