"""The keywords that all rooms share, checked and put into the form that the Rust side reads.

What is wrong is a `ValueError` of one line: the keyword, what was found, what was expected. Nothing has changed then.
"""

from __future__ import annotations

import json
import math
import operator
import os
import sys
import warnings
from collections.abc import Iterable, Mapping
from typing import Any, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

StrPath = Union[str, "os.PathLike[str]"]
Pool = Union[StrPath, Iterable[StrPath]]
Setting = Union[bool, int, float, str, "os.PathLike[str]"]

#: The largest seed and the largest count: configurations are TOML, whose integers have 64 bits and a sign.
MOST = 2**63 - 1


class Keywords(TypedDict):
    """What `_jostle` takes."""

    config: str | None
    overrides: list[str]
    crowd: str
    n_pedestrians: int | None
    robot_visible: bool | None
    pool: list[str]
    pool_half: list[str]
    recording: str | None
    recording_interval: float | None
    recording_gap: float | None


def keywords(
    crowd: str,
    *,
    n_pedestrians: int | None,
    robot_visible: bool | None,
    pool: Pool | None,
    pool_half: Pool | None,
    config: StrPath | None,
    settings: Mapping[str, Setting] | None,
    recording: StrPath | None = None,
    recording_interval: float | None = None,
    recording_gap: float | None = None,
) -> Keywords:
    """Checks and completes the keywords of a room among a crowd."""
    if not isinstance(crowd, str):
        raise refusal("crowd", crowd, "one of NH, IN, VA, SO, VO, SF, straight, stop-and-go, cross-play, recorded")
    if not (robot_visible is None or isinstance(robot_visible, (bool, np.bool_))):
        raise refusal("robot_visible", robot_visible, "True, False or None")
    for name, value in (("recording_interval", recording_interval), ("recording_gap", recording_gap)):
        if value is not None and recording is None:
            raise refusal(name, value, "None without a recording")
    return Keywords(
        config=path_or_none("config", config),
        overrides=overrides(settings),
        crowd=crowd,
        n_pedestrians=count("n_pedestrians", n_pedestrians, least=0),
        robot_visible=None if robot_visible is None else bool(robot_visible),
        pool=paths("pool", pool),
        pool_half=paths("pool_half", pool_half),
        recording=path_or_none("recording", recording),
        recording_interval=seconds("recording_interval", recording_interval),
        recording_gap=seconds("recording_gap", recording_gap),
    )


def refusal(what: str, found: object, expected: str) -> ValueError:
    """The error of a value, which is shown on one line and shortened."""
    try:
        shown = " ".join(repr(found).split())
    except Exception:  # noqa: BLE001 - whatever it is, its type can be told
        shown = f"a {type(found).__name__}"
    shown = shown if len(shown) <= 80 else f"{shown[:79]}…"
    return ValueError(f"{what}: found {shown}, expected {expected}")


def path_or_none(what: str, path: StrPath | None) -> str | None:
    """A path as text."""
    if path is None:
        return None
    try:
        return os.fsdecode(os.fspath(path))
    except TypeError:
        raise refusal(what, path, "a path") from None


def paths(what: str, pool: Pool | None) -> list[str]:
    """One path or several as texts. What they mean is found in Rust, for the commands and for Python alike."""
    if pool is None:
        return []
    if isinstance(pool, (str, os.PathLike)):
        pool = [pool]
    try:
        return [os.fsdecode(os.fspath(path)) for path in pool]
    except TypeError:
        raise refusal(what, pool, "a path or several") from None


def seconds(name: str, value: float | None) -> float | None:
    """A number of seconds, or `None`; its range is known to Rust."""
    if value is None:
        return None
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)):
        raise refusal(name, value, "a number of seconds or None")
    return float(value)


def count(name: str, value: int | None, least: int) -> int | None:
    """A whole number that Rust can take, or `None`."""
    return None if value is None else _whole(name, value, least, f"a whole number from {least} on")


def seed_or_none(value: int | None) -> int | None:
    """A seed, or `None`."""
    return None if value is None else _whole("seed", value, 0, f"a whole number from 0 to {MOST}")


def _whole(name: str, value: Any, least: int, expected: str) -> int:
    try:
        number = None if isinstance(value, (bool, np.bool_)) else operator.index(value)
    except TypeError:
        number = None
    if number is None or not least <= number <= MOST:
        raise refusal(name, value, expected)
    return number


def option(options: Mapping[str, Any] | None, known: str | None, passed_over: str | None = None) -> Any:
    """The one option that a reset knows, or `None` where it is not given; any other entry but `passed_over` is refused."""
    if options is None:
        return None
    if not isinstance(options, Mapping):
        raise refusal("options", options, "a dictionary or None")
    expected = "no entry" if known is None else f"{known} alone"
    for name in options:
        if name not in (known, passed_over):
            raise refusal("options", name, expected)
    return None if known is None else options.get(known)


def render_mode_or_none(mode: str | None) -> str | None:
    """A way to render that there is."""
    if mode not in (None, "rgb_array"):
        raise refusal("render_mode", mode, "rgb_array or None")
    return mode


def commands(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Actions as float32 of a shape. Numbers that are none, and ones too large for float32, are left to Rust, which names their row."""
    expected = f"numbers of shape {shape}"
    try:
        with np.errstate(over="ignore"):
            found = np.asarray(actions)
            if found.dtype.kind not in "fiub":
                raise refusal("actions", actions, expected)
            found = found.astype(np.float32, order="C", copy=False)
    except (TypeError, OverflowError):
        raise refusal("actions", actions, expected) from None
    except ValueError as error:
        if str(error).startswith("actions: "):
            raise
        # A list whose rows differ in length.
        raise refusal("actions", actions, expected) from None
    if found.shape != shape:
        raise ValueError(f"actions: found shape {found.shape}, expected {shape}")
    return found


def overrides(settings: Mapping[str, Setting] | None) -> list[str]:
    """Dotted keys and values as `key=value`, the values as TOML. A path of a map starts from the working directory of now, wherever a
    copy is made later."""
    if not (settings is None or isinstance(settings, Mapping)):
        raise refusal("settings", settings, "a dictionary of keys and values")
    found = {}
    for key, value in (settings or {}).items():
        plain = path_or_none(f"settings: {key}", value) if isinstance(value, os.PathLike) else value
        found[key] = os.path.abspath(plain) if key == "sim.room.map" and isinstance(plain, str) else plain
    return [f"{key}={_toml(key, value)}" for key, value in found.items()]


def warn(notes: list[str]) -> None:
    """A warning for each note, at the line outside of this package that has led here."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == __package__:
        frame, level = frame.f_back, level + 1
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=level)


def _toml(key: str, value: Any) -> str:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else ("nan" if math.isnan(value) else f"{value}")
    raise refusal(f"settings: {key}", value, "a bool, a number or a text")
