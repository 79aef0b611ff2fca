"""The keywords that all rooms share, put into the form that the Rust side reads."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypedDict, Union

StrPath = Union[str, "os.PathLike[str]"]
Pool = Union[StrPath, Iterable[StrPath]]
Setting = Union[bool, int, float, str]


class Keywords(TypedDict):
    """What `_jostle` takes."""

    config: str | None
    overrides: list[str]
    crowd: str
    n_pedestrians: int | None
    robot_visible: bool | None
    pool: list[str]


def keywords(
    crowd: str,
    *,
    n_pedestrians: int | None,
    robot_visible: bool | None,
    pool: Pool | None,
    config: StrPath | None,
    settings: Mapping[str, Setting] | None,
) -> Keywords:
    """Checks and completes the keywords of a room among a crowd; `ValueError` names what is wrong."""
    if not isinstance(crowd, str):
        raise ValueError(f"crowd: found {crowd!r}, expected one of NH, IN, VA, SO, VO, SF, straight, stop-and-go, cross-play")
    return Keywords(
        config=path_or_none(config),
        overrides=overrides(settings),
        crowd=crowd,
        n_pedestrians=count("n_pedestrians", n_pedestrians, least=0),
        robot_visible=robot_visible,
        pool=[str(path) for path in checkpoints(pool, half=crowd == "SO")],
    )


def path_or_none(path: StrPath | None) -> str | None:
    """A path as text."""
    return None if path is None else os.fspath(path)


def count(name: str, value: int | None, least: int) -> int | None:
    """A whole number that Rust can take, or `None`."""
    if value is not None and not least <= value < 2**63:
        raise ValueError(f"{name}: found {value}, expected a whole number from {least} on")
    return value


def overrides(settings: Mapping[str, Setting] | None) -> list[str]:
    """Dotted keys and values as `key=value`, the values as TOML."""
    return [f"{key}={_toml(key, value)}" for key, value in (settings or {}).items()]


def _toml(key: str, value: Any) -> str:
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ("nan" if math.isnan(value) else f"{value}")
    raise ValueError(f"settings: {key}: found {value!r}, expected a bool, a number or a text")


def checkpoints(pool: Pool | None, half: bool = False) -> list[Path]:
    """The files that a pool means: checkpoint files, run folders (their newest checkpoint), or folders of either, in the order
    of their names. With `half`, run folders and their checkpoints stand for the run's checkpoint at half its training."""
    if pool is None:
        return []
    paths = [pool] if isinstance(pool, (str, os.PathLike)) else list(pool)
    files: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir() and not _is_run(path):
            inside = [p for p in sorted(path.iterdir()) if _is_run(p) or p.suffix == ".safetensors"]
            if not inside:
                raise ValueError(f"pool: {path} holds no run folder and no checkpoint")
            files += map(checkpoint, inside)
        else:
            files.append(checkpoint(path))
    return [_half(file) if half else file for file in files]


def checkpoint(path: StrPath) -> Path:
    """The file itself, or the newest checkpoint of a run folder."""
    path = Path(path)
    if not _is_run(path):
        return path
    latest = path / "latest"
    if not latest.is_file():
        raise ValueError(f"{path} holds no finished checkpoint (no file `latest`)")
    return path / "checkpoints" / latest.read_text().strip()


def _is_run(path: Path) -> bool:
    return (path / "config.toml").is_file() and (path / "checkpoints").is_dir()


def _half(file: Path) -> Path:
    """A run's checkpoint at half the updates of `file`; a file outside a run stands for itself."""
    if not (_is_run(file.parent.parent) and file.stem.isdecimal()):
        return file
    half = file.with_stem(f"{int(file.stem) // 2:06d}")
    if not half.is_file():
        raise ValueError(f"pool: crowd SO needs {half}, which is not there; name half-trained checkpoints themselves")
    return half
