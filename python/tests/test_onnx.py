"""Models that `export` writes, run by onnxruntime, beside the policies that they come from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from conftest import ROOT
from numpy.typing import NDArray

import jostle

POLICY = ROOT / "checkpoints/m5-seed1-005000.safetensors"
STRONG = sorted((ROOT / "checkpoints").glob("strong-seed1-*.safetensors"))[0]


@pytest.fixture(scope="module")
def rows() -> NDArray[np.float32]:
    """1,000 observations of robots that drive among social force."""
    rooms = jostle.VectorRooms(num_envs=50, crowd="SF")
    kept = [rooms.reset(seed=5)[0]]
    rng = np.random.default_rng(5)
    for _ in range(19):
        kept.append(rooms.step(rng.uniform([0.0, -1.0], [1.0, 1.0], (50, 2)))[0])
    return np.concatenate(kept)


def session(file: Path) -> onnxruntime.InferenceSession:
    onnx.checker.check_model(onnx.load(file), full_check=True)
    return onnxruntime.InferenceSession(file)


def test_a_model_acts_as_its_policy(rows: NDArray[np.float32], xtask: Callable[..., str], tmp_path: Path) -> None:
    xtask("export", POLICY, "--out", tmp_path / "all.onnx")
    model = session(tmp_path / "all.onnx")
    for token in range(5):
        expected = jostle.Policy(POLICY, token)(rows)
        tokens = np.full(len(rows), token, np.int64)
        (found,) = model.run(["action"], {"observation": rows, "token": tokens})
        assert np.abs(found - expected).max() <= 1e-5
        xtask("export", POLICY, "--token", token, "--out", tmp_path / "one.onnx")
        (baked,) = session(tmp_path / "one.onnx").run(["action"], {"observation": rows})
        assert np.abs(baked - expected).max() <= 1e-5
    assert model.get_modelmeta().custom_metadata_map["jostle.n_behaviours"] == "5"


def test_a_model_of_a_policy_that_reads_motions_takes_encoded_rows(
    rows: NDArray[np.float32], xtask: Callable[..., str], tmp_path: Path
) -> None:
    xtask("export", STRONG, "--token", 0, "--out", tmp_path / "strong.onnx")
    policy = jostle.Policy(STRONG)
    inputs = policy.encode(rows)
    assert inputs.shape == (1000, 215) and np.isfinite(inputs).all()
    (found,) = session(tmp_path / "strong.onnx").run(["action"], {"inputs": inputs})
    assert np.abs(found - policy(rows)).max() <= 1e-5
    assert np.array_equal(policy.encode(rows[0]), inputs[0])


def test_without_an_encoder_a_row_is_its_own_input(rows: NDArray[np.float32]) -> None:
    assert np.array_equal(jostle.Policy(POLICY).encode(rows), rows)


def test_rows_that_cannot_be_encoded_are_refused(rows: NDArray[np.float32]) -> None:
    policy, broken = jostle.Policy(STRONG), rows[:2].copy()
    broken[1, 3] = np.nan
    with pytest.raises(ValueError, match=r"observations: found NaN in row 1, entry 3 \(a range\)"):
        policy.encode(broken)
    with pytest.raises(ValueError, match=r"observations: found shape \[2, 7\], expected rows of 1540"):
        policy.encode(rows[:2, :7])
