"""An entry of the leaderboard from Python, read by the command that makes the page."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, seek

import jostle

POLICIES = ROOT / "checkpoints"
WORDS = {"version": "1", "about": "turns to its goal", "command": "python seek.py", "episodes": 1}
POOLS = {
    "pool": sorted(POLICIES.glob("pool-*-005000.safetensors")),
    "pool_half": sorted(POLICIES.glob("pool-*-002500.safetensors")),
}


def test_an_entry_repeats_and_is_on_the_page(xtask: Callable[..., str], tmp_path: Path) -> None:
    entry = jostle.leaderboard_entry(seek, "seek", folder=tmp_path, **WORDS, **POOLS)
    assert json.loads((tmp_path / "seek.json").read_text()) == entry
    assert jostle.leaderboard_entry(seek, "seek", **WORDS, **POOLS) == entry
    assert len(entry["cells"]) == 54 and 0 < entry["score"]["mean"] < 1
    printed = xtask("leaderboard", "straight", "--episodes", 1, "--folder", tmp_path)
    assert "seek" in printed and "straight" in printed
    assert "<summary>seek</summary>" in (tmp_path / "index.html").read_text()
    assert "2 entries" in xtask("leaderboard", "--check", "--folder", tmp_path)
    # Both were run on the same scenes among the same pedestrians.
    other = json.loads((tmp_path / "straight.json").read_text())
    assert [cell["scene"] for cell in other["cells"]] == [cell["scene"] for cell in entry["cells"]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "../seek"}, 'name: found "../seek", expected 1 to 60 letters'),
        ({"fn": jostle.planner("dwa")}, "fn: found planner('dwa'), expected a function of observations"),
        ({"about": "two\nlines"}, "about: found 'two\\nlines', expected a text of one line"),
        ({"episodes": 0}, "episodes: found 0, expected a whole number from 1 on"),
        ({"settings": {"sim.robot.v_max": 2.0}}, "sim.robot: found"),
    ],
)
def test_what_is_no_entry_is_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.leaderboard_entry(**{"fn": seek, "name": "seek", **WORDS, **POOLS, **change})
    assert str(error.value).startswith(message)
