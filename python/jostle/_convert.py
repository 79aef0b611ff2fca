"""From the weights of a network, as PyTorch keeps them, to a policy's file."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._keywords import Setting, StrPath, count, path_or_none, refusal

#: Channels, kernels, stride and padding of the two convolutions.
CHANNELS, KERNELS, STRIDE, PADDING = 32, (5, 3), 2, 1
#: Numbers behind the scans of a row: goal x, goal y, v, ω.
TAIL = 4


def write_policy(
    path: StrPath,
    weights: Mapping[str, Any],
    *,
    beams: int = 512,
    n_agents: int = 5,
    sim: Mapping[str, Mapping[str, Setting]] | None = None,
) -> None:
    """Writes a network's weights as a policy that :class:`Policy`, ``evaluate``, ``replay``, ``export`` and ``jostle-ros`` take.

    The network is the paper's actor; its sizes are read from the shapes. L is the length behind the second convolution, 128 for
    512 beams; M the number of behaviours, 1 where there is none; E the length of their embedding.

    ================================  =========================  ==============================================================
    name                              shape                      what
    ================================  =========================  ==============================================================
    ``conv1.weight``, ``.bias``       [32, frames, 5], [32]      ``Conv1d(frames, 32, 5, stride=2, padding=1)``, ReLU
    ``conv2.weight``, ``.bias``       [32, 32, 3], [32]          ``Conv1d(32, 32, 3, stride=2, padding=1)``, ReLU
    ``fc1.weight``, ``.bias``         [F, 32·L], [F]             of the channels, one after the other, ReLU
    ``embedding.weight``              [M, E]                     a row for each token
    ``fc2.weight``, ``.bias``         [H, F + 4 + E], [H]        of laser feature, goal, velocity, embedding, ReLU
    ``mean_v.weight``, ``.bias``      [1, H], [1]                v, behind a sigmoid (m/s)
    ``mean_w.weight``, ``.bias``      [1, H], [1]                ω, behind tanh (rad/s)
    ``log_std``                       [2]                        of v and ω; 0 if left out, a test acts on the mean
    ================================  =========================  ==============================================================

    Args:
        path: the file, ``*.safetensors``; one that is there is replaced whole.
        weights: a ``state_dict`` or any mapping of these names (with or without ``actor.`` before them) to tensors or arrays.
        beams: beams of the laser.
        n_agents: agents of the rooms that it was trained in, the robot among them: a test has as many.
        sim: the room that it was trained in, as the ``[sim]`` part of a training file, such as ``{"robot": {"v_max": 0.5}}``.

    Raises:
        ValueError: one line with the tensor, what was found and what was expected.
    """
    target = path_or_none("path", path)
    if target is None:
        raise refusal("path", path, "a path")
    for name, value in (("beams", beams), ("n_agents", n_agents)):
        if count(name, value, least=1) is None:
            raise refusal(name, value, "a whole number from 1 on")
    tensors = {name.removeprefix("actor."): array(name, value) for name, value in weights.items()}
    tensors.setdefault("log_std", np.zeros(2, np.float32))
    network = sizes(tensors, beams)
    sections = {name: dict(section) for name, section in (sim or {}).items()}
    room = {**sections, "laser": {**sections.get("laser", {}), "beams": beams}}
    metadata = {
        "format": "jostle-policy-1",
        "network": json.dumps(network),
        "sim": json.dumps(room),
        "config_hash": hashlib.sha256(json.dumps([network, room]).encode()).hexdigest(),
        "commit": "imported",
        "n_agents": str(n_agents),
        **dict.fromkeys(["seed", "update", "transitions", "n_rooms"], "0"),
    }
    replace(Path(target), encode({f"actor.{name}": value for name, value in tensors.items()}, metadata))


def array(name: str, value: Any) -> NDArray[np.float32]:
    """A tensor, on whatever device, as numbers of single precision."""
    for step in ("detach", "cpu", "numpy"):
        value = getattr(value, step)() if hasattr(value, step) else value
    numbers = np.ascontiguousarray(value, np.float32)
    if not np.isfinite(numbers).all():
        raise refusal(name, "a number that is not finite", "finite numbers")
    return numbers


def sizes(tensors: Mapping[str, NDArray[np.float32]], beams: int) -> dict[str, float]:
    """The sizes of the network that the tensors' shapes are of."""

    def axis(name: str, n_axes: int, at: int) -> int:
        shape = tensors[name].shape if name in tensors else ()
        if len(shape) != n_axes:
            raise refusal(name, list(shape) if name in tensors else "nothing", f"a tensor of {n_axes} axes")
        return int(shape[at])

    frames, feature = axis("conv1.weight", 3, 1), axis("fc1.weight", 2, 0)
    behaviours, embedding = axis("embedding.weight", 2, 0), axis("embedding.weight", 2, 1)
    hidden = axis("fc2.weight", 2, 0)
    length = beams
    for kernel in KERNELS:
        length = (length + 2 * PADDING - kernel) // STRIDE + 1
    expected = {
        "conv1.weight": (CHANNELS, frames, KERNELS[0]),
        "conv1.bias": (CHANNELS,),
        "conv2.weight": (CHANNELS, CHANNELS, KERNELS[1]),
        "conv2.bias": (CHANNELS,),
        "fc1.weight": (feature, CHANNELS * length),
        "fc1.bias": (feature,),
        "embedding.weight": (behaviours, embedding),
        "fc2.weight": (hidden, feature + TAIL + embedding),
        "fc2.bias": (hidden,),
        "mean_v.weight": (1, hidden),
        "mean_v.bias": (1,),
        "mean_w.weight": (1, hidden),
        "mean_w.bias": (1,),
        "log_std": (2,),
    }
    for name, shape in expected.items():
        found = tensors[name].shape if name in tensors else None
        if found != shape:
            raise refusal(name, "nothing" if found is None else list(found), f"shape {list(shape)}")
    for name in tensors.keys() - expected.keys():
        raise refusal("weights", name, f"the tensors {', '.join(expected)}")
    return {
        "frames": frames,
        "beams": beams,
        "n_behaviours": behaviours,
        "embedding": embedding,
        "embedding_std": 1.0,
        "laser_feature": feature,
        "hidden": hidden,
        "log_std_init": 0.0,
    }


def encode(tensors: Mapping[str, NDArray[np.float32]], metadata: Mapping[str, str]) -> bytes:
    """A safetensors file whose checksum is of metadata and tensors in the order of their names, each part with its length before
    it."""
    by_name = sorted(tensors.items())
    digest = hashlib.sha256()
    for part in parts(by_name, metadata):
        digest.update(len(part).to_bytes(8, "little") + part)
    header: dict[str, Any] = {"__metadata__": {**metadata, "checksum": digest.hexdigest()}}
    start = 0
    for name, value in by_name:
        end = start + value.nbytes
        header[name] = {"dtype": "F32", "shape": list(value.shape), "data_offsets": [start, end]}
        start = end
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    values = b"".join(value.astype("<f4").tobytes() for _, value in by_name)
    return len(text).to_bytes(8, "little") + text + values


def parts(by_name: list[tuple[str, NDArray[np.float32]]], metadata: Mapping[str, str]) -> Iterator[bytes]:
    for key, text in sorted(metadata.items()):
        yield from (key.encode(), text.encode())
    for name, value in by_name:
        yield from (name.encode(), b"F32", str(list(value.shape)).encode(), value.astype("<f4").tobytes())


def replace(path: Path, content: bytes) -> None:
    """Puts a file in place in one step, so that no reader sees half of it."""
    handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            os.fsync(file.fileno())
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise
