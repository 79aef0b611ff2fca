"""Policies that are made of PyTorch's networks, beside these networks."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import ROOT

import jostle

sys.path.append(str(ROOT / "python/examples"))
from from_pytorch import Actor


def network(seed: int, n_behaviours: int, **sizes: int) -> Actor:
    """A network whose weights are large enough to move its outputs."""
    torch.manual_seed(seed)
    actor = Actor(n_behaviours, **sizes)
    with torch.no_grad():
        for weights in actor.parameters():
            weights.mul_(2.0)
        actor.log_std.copy_(torch.tensor([-0.5, 0.25]))
    return actor


@pytest.mark.parametrize(("n_behaviours", "beams", "embedding"), [(1, 512, 32), (5, 512, 2), (3, 180, 8)])
def test_a_converted_network_acts_as_it_does_in_pytorch(
    tmp_path: Path, n_behaviours: int, beams: int, embedding: int
) -> None:
    actor = network(7, n_behaviours, beams=beams, embedding=embedding)
    jostle.write_policy(tmp_path / "policy.safetensors", actor.state_dict(), beams=beams)
    rng = np.random.default_rng(3)
    scans = rng.uniform(-0.5, 0.5, (200, 3 * beams))
    rows = np.concatenate([scans, rng.normal(0.0, 4.0, (200, 4))], 1).astype(np.float32)
    for token in range(n_behaviours):
        with torch.no_grad():
            expected = actor(torch.from_numpy(rows), torch.full((200,), token)).numpy()
        policy = jostle.Policy(tmp_path / "policy.safetensors", token)
        assert np.abs(policy(rows) - expected).max() <= 1e-5
        assert expected.std(axis=0).min() > 0.01
    assert policy.n_behaviours == n_behaviours and len(policy.beam_angles) == beams


def test_every_command_takes_a_converted_policy(tmp_path: Path, xtask: Callable[..., str]) -> None:
    actor, file = network(1, 2), tmp_path / "converted.safetensors"
    prefixed = {f"actor.{name}": weights for name, weights in actor.state_dict().items()}
    jostle.write_policy(file, prefixed, n_agents=3, sim={"episode": {"step_limit": 30}})
    found = jostle.evaluate(jostle.Policy(file, 1), crowd="SF", episodes=4)
    assert len(found.records) == 4 and max(record["steps"] for record in found.records) <= 30
    xtask("evaluate", file, "--crowds", "SF", "--episodes", 4, "--token", 1, "--out", tmp_path / "out")
    (records,) = (tmp_path / "out/records").glob("*.ndjson")
    own = [json.loads(line) for line in records.read_text(encoding="utf-8").splitlines()]
    assert [(record["outcome"], record["steps"]) for record in own] == [
        (record["outcome"], record["steps"]) for record in found.records
    ]


def test_the_same_weights_are_the_same_file(tmp_path: Path) -> None:
    weights = network(2, 1).state_dict()
    for name in ("one", "two"):
        jostle.write_policy(tmp_path / name, dict(reversed(weights.items())) if name == "two" else weights)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fc1.weight": np.zeros((256, 4000))}, "fc1.weight: found [256, 4000], expected shape [256, 4096]"),
        ({"conv1.weight": np.zeros((32, 3))}, "conv1.weight: found [32, 3], expected a tensor of 3 axes"),
        ({"mean_v.bias": np.full(1, np.nan)}, "mean_v.bias: found 'a number that is not finite'"),
        ({"value.bias": np.zeros(1)}, "weights: found 'value.bias', expected the tensors conv1.weight"),
        ({"fc2.bias": None}, "fc2.bias: found 'nothing', expected shape [128]"),
    ],
)
def test_what_is_no_such_network_is_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    weights = {**network(2, 1).state_dict(), **change}
    weights = {name: value for name, value in weights.items() if value is not None}
    with pytest.raises(ValueError) as raised:
        jostle.write_policy(tmp_path / "policy.safetensors", weights)
    assert str(raised.value).startswith(message)
    assert list(tmp_path.iterdir()) == []
