"""Robots that nobody trained, by their names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from . import _jostle
from ._env import Float32
from ._keywords import Setting, StrPath, overrides, path_or_none, refusal
from ._policy import answer

#: The planners: the first four read observation rows, the last two everyone's true position and velocity.
PLANNERS = ("straight", "brake", "goal-seeker", "dwa", "orca", "social-force")


class Planner:
    """A robot that nobody trained (:func:`jostle.planner`): a function of observations, as :class:`jostle.Policy` is one.

    It has no memory: an action is a function of its own row. A row with NaN or an infinite number is a `ValueError` that names row
    and entry.

    Attributes:
        name: its name.
        description: what it does, in a line.
        knows_positions: whether it reads everyone's true position and velocity instead of rows. Then only :func:`jostle.evaluate`
            can drive it, and to call it is a `ValueError`.
        beam_angles: ``float64[beams]``, where the beams point that it expects, from straight ahead, counter-clockwise (rad).
    """

    def __init__(self, core: _jostle.Planner) -> None:
        self.core = core
        self.name, self.description = core.name, core.description
        self.knows_positions = core.knows_positions
        self.beam_angles = np.array(core.beam_angles)

    def __call__(self, observations: ArrayLike) -> Float32:
        """Actions ``float32[B, 2]`` for observations ``[B, 1540]``, or ``[2]`` for ``[1540]``."""
        return answer(self.core.act, observations)

    def __repr__(self) -> str:
        return f"planner({self.name!r})"


def planner(
    name: str, *, config: StrPath | None = None, settings: Mapping[str, Setting] | None = None
) -> Planner:
    """A planner by its name: a robot that nobody trained, to hold learned ones against.

    ``straight`` drives to its goal as if nobody were there, ``brake`` slows down for what is near ahead, ``goal-seeker`` turns to the
    free direction nearest to its goal, ``dwa`` rolls out commands among things whose velocities it reads from the last two scans.
    ``orca`` and ``social-force`` know where everyone is and how fast they walk, which no laser tells: :func:`jostle.evaluate` tests
    them, rows do not drive them. ``docs/planners.md`` has the rules and how settings were chosen.

    Args:
        name: one of :data:`jostle.PLANNERS`.
        config: a TOML file as ``cargo xtask train`` reads it, of which robot and laser are taken (and, in
            :func:`jostle.evaluate`, the rest of the simulator and the number of agents, unless they are given there).
        settings: keys of it by their dotted names.

    Raises:
        ValueError: one line with what was found and what was expected.
    """
    if not isinstance(name, str):
        raise refusal("planner", name, f"one of {', '.join(PLANNERS)}")
    return Planner(_jostle.Planner(name, path_or_none("config", config), overrides(settings)))
