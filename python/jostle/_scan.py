"""From a robot's own numbers to the row that a policy reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._keywords import refusal

Float32 = NDArray[np.float32]


def scan_to_row(scans: ArrayLike, goal: ArrayLike, velocity: ArrayLike, *, max_range: float = 10.0) -> Float32:
    """An observation ``float32[3·beams + 4]`` from what a robot's scanner, odometry and planner say.

    Ranges are those of ROS' ``LaserScan`` (REP 117): ``+inf`` is a beam that met nothing and becomes ``max_range``, as does
    any range beyond it; ``-inf`` is something too near to be measured and becomes 0. ``NaN`` is no measurement and is
    refused: what stands there instead, the last scan's range or ``max_range``, is the caller's to decide.

    Args:
        scans: ranges ``[3, beams]`` in metres, oldest scan first, each counter-clockwise from straight ahead; or ``[beams]``,
            one scan for all three, as at the start of an episode.
        goal: ``[2]``, in the robot's frame: x forward, y left (m).
        velocity: ``[2]``, v (m/s) and ω (rad/s).
        max_range: the range of the laser that the policy was trained with (m).

    Raises:
        ValueError: one line with what was found and what was expected.
    """
    if not (isinstance(max_range, (int, float, np.integer, np.floating)) and 0.0 < max_range < np.inf):
        raise refusal("max_range", max_range, "a finite number above 0")
    ranges = _numbers("scans", scans)
    if ranges.ndim == 1:
        ranges = np.stack([ranges] * 3)
    if ranges.ndim != 2 or len(ranges) != 3 or ranges.shape[1] == 0:
        raise ValueError(f"scans: found shape {np.shape(scans)}, expected (3, beams) or (beams,)")
    if np.isnan(ranges).any():
        scan, beam = np.argwhere(np.isnan(ranges))[0]
        raise ValueError(f"scans: found nan in scan {scan}, beam {beam}, expected a range, or inf where nothing is met")
    tail = []
    for name, values in (("goal", goal), ("velocity", velocity)):
        numbers = _numbers(name, values)
        if numbers.shape != (2,):
            raise ValueError(f"{name}: found shape {numbers.shape}, expected (2,)")
        if not np.isfinite(numbers).all():
            raise refusal(name, values, "two finite numbers")
        tail.append(numbers)
    # In single precision from here on, as the simulator does it: the same range gives the same bits.
    reach = np.float32(max_range)
    scaled = np.clip(ranges, 0.0, max_range).astype(np.float32) / reach - np.float32(0.5)
    return np.concatenate([scaled.ravel(), *tail]).astype(np.float32)


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        found = np.asarray(values)
        if found.dtype.kind not in "fiu":
            raise TypeError
        return found.astype(np.float64)
    except (TypeError, ValueError):
        raise refusal(name, values, "an array of numbers") from None
