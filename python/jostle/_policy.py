"""Policies that jostle trained."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import _jostle
from ._env import Float32
from ._keywords import StrPath, checkpoint


class Policy:
    """A trained policy with one behaviour token: a function of observations that answers with the mean of its actions.

    Args:
        path: a checkpoint file, or a run folder for its newest checkpoint.
        token: the behaviour token z, less than ``n_behaviours``.

    Attributes:
        beam_angles: ``float64[beams]``, where the beams of the laser point that it was trained with, from straight ahead,
            counter-clockwise (rad); ``None`` if its file does not say. An environment's own are ``env.beam_angles``.
    """

    def __init__(self, path: StrPath, token: int = 0) -> None:
        if not 0 <= token < 2**32:
            raise ValueError(f"token: found {token}, expected a whole number from 0 on")
        self.core = _jostle.Policy(str(checkpoint(path)), token)
        self.name, self.token, self.n_behaviours = self.core.name, token, self.core.n_behaviours
        angles = self.core.beam_angles
        self.beam_angles = None if angles is None else np.array(angles)

    def __call__(self, observations: ArrayLike) -> Float32:
        """Actions ``float32[B, 2]`` for observations ``[B, 1540]``, or ``[2]`` for ``[1540]``."""
        rows = np.ascontiguousarray(observations, np.float32)
        batch = np.atleast_2d(rows)
        actions = np.empty((len(batch), 2), np.float32)
        self.core.act(batch, actions)
        return actions if rows.ndim == 2 else actions[0]

    def __repr__(self) -> str:
        return f"Policy({self.name!r}, token={self.token} of {self.n_behaviours})"
