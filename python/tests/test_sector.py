"""Lasers that do not see all round."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import jostle

#: 270° centred ahead, without noise.
SECTOR = {"sim.laser.fov": 1.5 * np.pi, "sim.laser.angle_min": -0.75 * np.pi, "sim.laser.beams": 385, "sim.laser.noise_std": 0.0}


def test_a_sector_is_what_the_full_circle_sees_there() -> None:
    circle = jostle.RoomEnv("SF", settings={"sim.laser.noise_std": 0.0})
    sector = jostle.RoomEnv("SF", settings=SECTOR)
    assert sector.observation_space.shape == (3 * 385 + 4,)
    np.testing.assert_allclose(circle.beam_angles, np.linspace(0, 2 * np.pi, 513)[:-1])
    np.testing.assert_allclose(sector.beam_angles, np.linspace(-0.75 * np.pi, 0.75 * np.pi, 385), atol=1e-6)
    # As many steps of beams as the full circle has in three quarters: beam k is the circle's k − 192.
    apart = 0
    for seed in range(5):
        seen, of_circle = sector.reset(seed=seed)[0], circle.reset(seed=seed)[0]
        np.testing.assert_array_equal(seen[-4:], of_circle[-4:])
        scans, scans_of_circle = jostle.split(seen)[0], jostle.split(of_circle)[0]
        apart += int((np.abs(scans - np.roll(scans_of_circle, 192, axis=1)[:, :385]) > 1e-4).sum())
    # A silhouette may be grazed.
    assert apart <= 5 * 9


def test_every_environment_says_where_its_beams_point() -> None:
    rooms = jostle.VectorRooms(2, "SF", settings=SECTOR)
    assert rooms.single_observation_space.shape == (3 * 385 + 4,)
    rows, _ = rooms.reset(seed=0)
    np.testing.assert_array_equal(rows[1], jostle.RoomEnv("SF", settings=SECTOR).reset(seed=1)[0])
    np.testing.assert_allclose(rooms.beam_angles[[0, -1]], [-0.75 * np.pi, 0.75 * np.pi], atol=1e-6)
    robots = jostle.parallel_env(2, settings=SECTOR)
    assert robots.observation_space("robot_0").shape == (3 * 385 + 4,)
    np.testing.assert_array_equal(robots.beam_angles, rooms.beam_angles)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sim.laser.fov": 270}, "settings: sim.laser.fov=270: sim.laser.fov: found 270, expected radians in (0, 6.2831855]"),
        (
            {"sim.laser.angle_min": -135.0},
            "settings: sim.laser.angle_min=-135.0: sim.laser.angle_min: found -135, expected radians in [-6.2831855, 6.2831855]",
        ),
    ],
)
def test_degrees_are_one_line(settings: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.RoomEnv("SF", settings=settings)
    assert str(error.value) == message


def test_a_policy_says_its_laser_and_is_refused_where_beams_point_elsewhere(
    xtask: Callable[..., str], pool: Path, tmp_path: Path
) -> None:
    keys = {"updates": 1, "horizon": 4, "minibatch": 20, "n_rooms": 1, "sim.laser.fov": 3.0, "sim.laser.angle_min": -1.5}
    settings = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
    xtask("train", "--config", "configs/small_m1.toml", *settings, "--out", tmp_path / "run")
    policy = jostle.Policy(tmp_path / "run")
    assert policy.beam_angles is not None
    np.testing.assert_allclose(policy.beam_angles, np.linspace(-1.5, 1.5, 512), atol=1e-6)
    assert jostle.evaluate(policy, "SF", episodes=3).episodes == 3
    # Settings change keys of what it was trained with, and leave the rest as it was.
    noisy, quiet = (jostle.evaluate(policy, "SF", episodes=3, settings={"sim.laser.noise_std": std}) for std in (0.5, 0.0))
    assert noisy.records != quiet.records
    with pytest.raises(ValueError) as error:
        jostle.evaluate(policy, "SF", episodes=3, settings={"sim.laser.fov": 2.0})
    assert str(error.value).startswith("laser of the policy: found ")
    assert str(error.value).endswith(
        ", trained with a laser that sees 3 rad from -1.5 rad, expected one trained with the room's, which sees 2 rad from -1.5 rad"
    )
    # Pedestrians have the room's laser, too.
    with pytest.raises(ValueError, match="^laser of the policy: found .* that sees all round from 0 rad, expected"):
        jostle.evaluate(policy, "NH", pool=pool, episodes=3)
