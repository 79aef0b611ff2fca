"""Policies that jostle trained."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from . import _jostle
from ._env import Float32
from ._keywords import StrPath, count, path_or_none, refusal


def answer(write: Callable[[Float32, Float32], None], observations: ArrayLike, width: int = 2) -> Float32:
    """The rows ``[B, width]`` that `write` makes of observations, or the row that it makes of a single one."""
    with np.errstate(over="ignore"):
        rows = np.ascontiguousarray(observations, np.float32)
    batch = np.atleast_2d(rows)
    answers = np.empty((len(batch), width), np.float32)
    write(batch, answers)
    return answers if rows.ndim == 2 else answers[0]


class Policy:
    """A trained policy with one behaviour token: a function of observations that answers with the mean of its actions.

    It refuses numbers that are none: a row with NaN or an infinite number is a `ValueError` that names row and entry. What a
    scanner says of beams that meet nothing is infinite in ROS; :func:`jostle.scan_to_row` makes a row of it.

    Args:
        path: a checkpoint file, or a run folder for its newest checkpoint.
        token: the behaviour token z, less than ``n_behaviours``.

    Attributes:
        beam_angles: ``float64[beams]``, where the beams of the laser point that it was trained with, from straight ahead,
            counter-clockwise (rad); ``None`` if its file does not say. An environment's own are ``env.beam_angles``.

    Raises:
        ValueError: one line with what was found and what was expected.
    """

    def __init__(self, path: StrPath, token: int = 0) -> None:
        text = path_or_none("path", path)
        if text is None:
            raise refusal("path", path, "a path")
        number = count("token", token, least=0)
        if number is None or number >= 2**32:
            raise refusal("token", token, "a whole number from 0 on")
        token = number
        self.core = _jostle.Policy(text, token)
        self.name, self.token, self.n_behaviours = self.core.name, token, self.core.n_behaviours
        angles = self.core.beam_angles
        self.beam_angles = None if angles is None else np.array(angles)

    def __call__(self, observations: ArrayLike) -> Float32:
        """Actions ``float32[B, 2]`` for observations ``[B, 1540]``, or ``[2]`` for ``[1540]``."""
        return answer(self.core.act, observations)

    def encode(self, observations: ArrayLike) -> Float32:
        """What the policy's network reads, ``float32[B, n]``, of observations ``[B, 1540]``, or ``[n]`` of ``[1540]``: the rows
        themselves, pooled beams, or bodies with their velocities, as it was trained. An exported model of the latter takes it
        as its input.
        """
        return answer(self.core.encode, observations, self.core.input_len)

    def __repr__(self) -> str:
        return f"Policy({self.name!r}, token={self.token} of {self.n_behaviours})"
