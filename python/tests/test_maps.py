"""Maps in Python: paths, what is not read, what is refused."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import same

import jostle

YAML = """image: m.pgm
resolution: 0.5
origin: [-10.0, -10.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
FREE = b"P5 40 40 255\n" + bytes([254] * 1600)
WALLS = "walls = { min = [-10.0, -10.0], max = [10.0, 10.0] }\n"


def grid(folder: Path, more: str = "") -> Path:
    """A free room of 20 m by 20 m as a ROS map."""
    (folder / "m.pgm").write_bytes(FREE)
    (folder / "m.yaml").write_text(YAML + more)
    return folder / "m.yaml"


MAKERS: list[Callable[[dict], object]] = [
    lambda settings: jostle.RoomEnv("SF", settings=settings),
    lambda settings: jostle.VectorRooms(2, "SF", settings=settings),
    lambda settings: jostle.parallel_env(2, settings=settings),
    lambda settings: jostle.evaluate(lambda rows: np.zeros((len(rows), 2)), "SF", episodes=1, settings=settings),
]


@pytest.mark.parametrize("make", MAKERS)
def test_keys_that_are_not_read_are_a_warning_at_the_callers_line(make: Callable[[dict], object], tmp_path: Path) -> None:
    path = grid(tmp_path, "map_id: /a/7f\nareas: {a: 1}\n")
    with pytest.warns(UserWarning) as told:
        made = make({"sim.room.map": path})
    assert [str(warning.message) for warning in told] == [f"{path}: not read: map_id, areas"]
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make({"sim.room.map": grid(tmp_path)})
        if hasattr(made, "reset"):
            # What was told once is not told of a copy.
            grid(tmp_path, "map_id: /a/7f\nareas: {a: 1}\n")
            copy.deepcopy(made)
            pickle.loads(pickle.dumps(made))


def test_a_policys_own_map_is_told_of_as_well(xtask: Callable[..., str], tmp_path: Path) -> None:
    path = grid(tmp_path, "map_id: /a/7f\n")
    keys = {"updates": 1, "horizon": 4, "minibatch": 20, "n_rooms": 1, "sim.room.map": f'"{path}"'}
    settings = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
    xtask("train", "--config", "configs/small_m1.toml", *settings, "--out", tmp_path / "run")
    policy = jostle.Policy(tmp_path / "run")
    with pytest.warns(UserWarning, match="not read: map_id$"):
        jostle.evaluate(policy, "SF", episodes=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jostle.evaluate(policy, "SF", episodes=1, settings={"sim.room.map": grid(tmp_path)})


def test_a_map_starts_from_its_file_and_a_setting_from_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And copies go on wherever they are made."""
    grid(tmp_path)
    for folder in ("configs", "elsewhere"):
        (tmp_path / folder).mkdir()
    (tmp_path / "configs/a.toml").write_text('[sim.room]\nmap = "../m.yaml"\n')
    monkeypatch.chdir(tmp_path)
    by_file = jostle.RoomEnv("SF", config="configs/a.toml")
    by_setting = jostle.RoomEnv("SF", settings={"sim.room.map": "m.yaml"})
    robots = jostle.parallel_env(2, settings={"sim.room.map": "m.yaml"})
    same(by_file.reset(seed=1), by_setting.reset(seed=1))
    robots.reset(seed=1)
    pickled = [pickle.dumps(env) for env in (by_file, by_setting, robots)]
    monkeypatch.chdir(tmp_path / "elsewhere")
    first, second, third = map(pickle.loads, pickled)
    same(first.step([1.0, 0.1]), by_file.step([1.0, 0.1]))
    same(second.step([1.0, 0.1]), by_setting.step([1.0, 0.1]))
    actions = {agent: np.array([1.0, 0.1]) for agent in robots.agents}
    same(third.step(actions), robots.step(actions))
    with pytest.raises(ValueError, match="m.yaml: file: found No such file"):
        jostle.RoomEnv("SF", settings={"sim.room.map": "m.yaml"})


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("walls = { min = [5e5, 5e5], max = [500020.0, 500020.0] }\n", "walls: found [500000, 500000]"),
        (f"{WALLS}[[obstacle]]\npolygon = [[0, 0], [1, 0], [1, 5e-17], [1, 1], [0, 1]]\n", "obstacle 0: found 0.0000"),
        (f"{WALLS}[[obstacle]]\npolygon = [[0, 0], [1, 0], [2, 1e-17]]\n", "obstacle 0: found an outline that goes back"),
        (f"{WALLS}[[obstacle]]\ncircle = {{ centre = [4e6, 0], radius = 1 }}\n", "obstacle 0: found [4000000, 0]"),
        (f"{WALLS}[[obstacle]]\nbox = {{ centre = [0, 0], length = 20, width = 20 }}\n", "spawn.wall_clearance: found 1"),
    ],
)
def test_a_map_that_cannot_be_used_is_one_line(make: Callable[[dict], object], text: str, found: str, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        make({"sim.room.map": str(path)})
    assert str(error.value).startswith((f"{path}: {found}", found))
    assert "\n" not in str(error.value)


def test_start_and_goal_are_on_one_side_of_a_wall(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f"{WALLS}[[obstacle]]\nsegment = [[-10.0, 1.0], [10.0, 1.0]]\n")
    env = jostle.RoomEnv("SF", settings={"sim.room.map": path})
    sides = set()
    for seed in range(60):
        _, info = env.reset(seed=seed)
        assert (info["pose"][1] > 1.0) == (info["goal"][1] > 1.0)
        sides.add(bool(info["pose"][1] > 1.0))
    assert sides == {False, True}
