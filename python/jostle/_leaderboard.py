"""The leaderboard: a policy of one's own on every scene of the standard suite among the six crowds."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _jostle
from ._env import Float32
from ._keywords import Pool, Setting, StrPath, count, overrides, path_or_none, paths, refusal
from ._planner import Planner
from ._policy import Policy


def leaderboard_entry(
    fn: Callable[[Float32], ArrayLike],
    name: str,
    *,
    version: str,
    about: str,
    command: str,
    pool: Pool,
    pool_half: Pool,
    folder: StrPath | None = None,
    episodes: int = 100,
    config: StrPath | None = None,
    settings: Mapping[str, Setting] | None = None,
) -> dict[str, Any]:
    """Runs a policy as ``cargo xtask leaderboard`` does and gives its entry, which is stored as ``folder/NAME.json``.

    Args:
        fn: a function of observations, as in :func:`jostle.evaluate`. A :class:`jostle.Policy` or a planner is entered by
            ``cargo xtask leaderboard`` instead.
        name: what the board calls it: letters, digits, dots, hyphens, underscores.
        version: to be changed whenever the policy acts otherwise.
        about: a line about it.
        command: the line that runs it again, such as ``python mine.py``.
        pool: the shipped policies that drive learned pedestrians: ``checkpoints/pool-*-005000.safetensors``, in order. Others give an
            entry that cannot be compared.
        pool_half: the same at half their training: ``checkpoints/pool-*-002500.safetensors``.
        folder: where the entry is stored; nowhere if left out. ``cargo xtask leaderboard`` then makes the page.
        episodes: of each of the 54 cells.
        config: a TOML file as ``cargo xtask train`` reads it, of which the laser is taken. Robot, episode and spawning must be the
            usual ones.
        settings: keys of it by their dotted names.

    Raises:
        ValueError: one line with what was found and what was expected.
        Exception: whatever ``fn`` raises.
    """
    if isinstance(fn, (Policy, Planner)) or not callable(fn):
        raise refusal("fn", fn, "a function of observations; `cargo xtask leaderboard` enters policies and planners")
    said = {"name": name, "version": version, "about": about, "command": command}
    for key, value in said.items():
        if not isinstance(value, str) or not value or "\n" in value:
            raise refusal(key, value, "a text of one line")
    count("episodes", episodes, least=1)

    def act(observations: Float32, n: int) -> Float32:
        return np.ascontiguousarray(fn(observations[:n]), np.float32)

    def zeros(shape: tuple[int, int]) -> Float32:
        return np.zeros(shape, np.float32)

    text = _jostle.board_entry(
        act,
        zeros,
        said,
        path_or_none("config", config),
        overrides(settings),
        paths("pool", pool),
        paths("pool_half", pool_half),
        episodes,
    )
    if folder is not None:
        target = Path(os.fsdecode(os.fspath(folder))) / f"{name}.json"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    entry: dict[str, Any] = json.loads(text)
    return entry
