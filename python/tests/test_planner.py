"""Planners by name: the command line's, a batch like its rows, and what those that know positions need."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import jostle


@pytest.mark.parametrize("name", ["straight", "dwa", "orca", "social-force"])
def test_a_planner_through_python_is_the_planner_on_the_command_line(
    name: str, xtask: Callable[..., str], tmp_path: Path
) -> None:
    xtask("evaluate", name, "--crowds", "SF", "--episodes", 12, "--seed", 3, "--out", tmp_path)
    (records,) = (tmp_path / "records").glob("*.ndjson")
    expected = [json.loads(line) for line in records.read_text().splitlines()]
    planner = jostle.planner(name)
    found = jostle.evaluate(planner, "SF", episodes=12, seed=3)
    assert found.records == expected
    assert found.name == name and found.n_agents == 5
    if not planner.knows_positions:
        through_python = jostle.evaluate(lambda rows: planner(rows), "SF", episodes=12, seed=3)
        what = expected[0].keys() - {"cell", "provenance"}
        assert [[r[key] for key in what] for r in through_python.records] == [[r[key] for key in what] for r in expected]


def test_a_batch_is_answered_row_by_row() -> None:
    rooms = jostle.VectorRooms(20, "SF")
    observations, _ = rooms.reset(seed=5)
    for name in jostle.PLANNERS:
        planner = jostle.planner(name)
        assert repr(planner) == f"planner({name!r})" and planner.description
        assert len(planner.beam_angles) == 512
        if planner.knows_positions:
            continue
        actions = planner(observations)
        assert actions.shape == (20, 2) and actions.dtype == np.float32
        for row, action in zip(observations, actions, strict=True):
            assert planner(row).tolist() == action.tolist()
    assert jostle.planner("dwa")(observations[0]).tolist() != jostle.planner("straight")(-observations[0]).tolist()


@pytest.mark.parametrize("name", ["orca", "social-force"])
def test_who_knows_positions_says_what_it_needs(name: str) -> None:
    planner = jostle.planner(name)
    assert planner.knows_positions
    with pytest.raises(ValueError) as error:
        planner(np.zeros(1540))
    expected = "everyone's true position and velocity, which a row does not tell; jostle.evaluate tests it"
    assert str(error.value) == f"planner {name}: found observation rows, expected {expected}"


def test_a_planner_is_made_for_a_robot() -> None:
    settings = {"sim.laser.beams": 64, "n_agents": 3}
    planner = jostle.planner("dwa", settings=settings)
    assert len(planner.beam_angles) == 64
    found = jostle.evaluate(planner, "VO", episodes=3)
    assert found.n_agents == 3
    assert found.records == jostle.evaluate(planner, "VO", episodes=3, settings=settings).records
    assert jostle.evaluate(planner, "VO", episodes=3, n_pedestrians=1).n_agents == 2
    with pytest.raises(ValueError, match=r"found shape \[1, 1540\], expected rows of 196"):
        planner(np.zeros(1540))
    with pytest.raises(ValueError, match="row 0"):
        planner(np.full(196, np.nan))


def test_copies_and_pickles_plan_alike() -> None:
    planner = jostle.planner("goal-seeker", settings={"sim.laser.beams": 64})
    rows = np.random.default_rng(1).uniform(-0.5, 0.5, (4, 196)).astype(np.float32)
    for other in (copy.deepcopy(planner), pickle.loads(pickle.dumps(planner))):
        assert other.name == planner.name and (other(rows) == planner(rows)).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("dwb", "planner: found dwb, expected straight, brake, goal-seeker, dwa, orca or social-force; did you mean dwa?"),
        (3, "planner: found 3, expected one of straight, brake, goal-seeker, dwa, orca, social-force"),
    ],
)
def test_a_slip_is_one_line(name: str, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.planner(name)
    assert str(error.value) == message


def test_the_names_are_rusts() -> None:
    assert [jostle.planner(name).name for name in jostle.PLANNERS] == list(jostle.PLANNERS)
