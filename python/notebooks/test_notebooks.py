"""Runs the notebooks from top to bottom, as a reader would, in the environment that the tests run in."""

from __future__ import annotations

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parent
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

#: What a cell of ours puts before a notebook's first: jostle is the one that was installed.
FIRST = """
import jostle
assert jostle.__file__.startswith({installed!r}), jostle.__file__
"""


def test_both_notebooks_are_there() -> None:
    assert [notebook.stem for notebook in NOTEBOOKS] == ["test_a_planner", "train_with_stable_baselines3"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    codes = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in codes), "a notebook is kept without output"
    if "JOSTLE_INSTALLED" in os.environ:
        text = FIRST.format(installed=os.environ["JOSTLE_INSTALLED"])
        notebook.cells.insert(0, nbformat.v4.new_code_cell(text))
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    # The time is for a busy machine; on two free cores a notebook takes less than two minutes.
    NotebookClient(notebook, timeout=1200, kernel_name="python3", resources={"metadata": {"path": FOLDER}}).execute()
    printed = [output for cell in codes for output in cell.outputs if output.output_type == "stream"]
    assert any("success" in output.text for output in printed if output.name == "stdout")
    assert any("image/png" in output.get("data", {}) for cell in codes for output in cell.outputs)
