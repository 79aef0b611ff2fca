"""What the tests share: jostle's own command line, and policies for learned pedestrians."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]


def seek(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turns to the goal and drives on, unless something is near ahead. Sums and comparisons alone: the same bits anywhere."""
    x, y, ahead = observations[:, -4], observations[:, -3], observations[:, 1024:1056].min(axis=1)
    forward = np.where((x > 0) & (ahead > np.float32(-0.4)), 1, 0)
    turn = np.where(y > 0, 1, -1) * np.minimum(np.abs(y), 1)
    return np.stack([forward, turn], axis=1).astype(np.float32)


#: Seeds that are none, with the refusal of each.
WRONG_SEEDS = [
    (seed, f"seed: found {seed!r}, expected a whole number from 0 to 9223372036854775807")
    for seed in (-1, 2**63, 2**64, 1.5, "3", True)
]


def same(found: object, expected: object) -> None:
    """Whether two answers of environments are one another's to the last bit, whatever they are made of."""
    assert type(found) is type(expected)
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key in expected:
            same(found[key], expected[key])
    elif isinstance(expected, (tuple, list)):
        assert len(found) == len(expected)
        for pair in zip(found, expected, strict=True):
            same(*pair)
    elif isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype and found.shape == expected.shape
        if expected.dtype == object:
            same(found.tolist(), expected.tolist())
        else:
            assert found.tobytes() == expected.tobytes()
    else:
        np.testing.assert_equal(found, expected)


@pytest.fixture(scope="session")
def xtask() -> Callable[..., str]:
    """Runs a command of `cargo xtask` at the repository's root; its standard output."""
    program = [os.environ["JOSTLE_XTASK"]] if "JOSTLE_XTASK" in os.environ else ["cargo", "xtask"]

    def run(*arguments: object) -> str:
        words = [*program, *map(str, arguments)]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def pool(xtask: Callable[..., str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two runs that were hardly trained, with their half-trained checkpoints."""
    folder = tmp_path_factory.mktemp("pool")
    for seed in (1, 2):
        keys = {"seed": seed, "updates": 4, "checkpoint_every": 1, "horizon": 4, "minibatch": 20, "n_rooms": 1}
        settings = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
        xtask("train", "--config", "configs/small_m1.toml", *settings, "--out", folder / f"run{seed}")
    return folder
