"""The test's episodes for a robot that another simulator moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _jostle
from ._env import Float32
from ._keywords import Pool, Setting, StrPath, count, keywords, seed_or_none, warn


class Obstacle(NamedTuple):
    """A solid thing, in the world.

    Attributes:
        kind: box, circle, polygon or segment.
        numbers: x, y, heading, length, width of a box; x, y, radius of a circle; ``[n, 2]`` corners of a convex polygon,
            counter-clockwise; ``[2, 2]`` ends of a segment. Metres and radians.
    """

    kind: str
    numbers: Float32


class PeerRoom:
    """A room whose robot and laser are in another simulator, and whose pedestrians are here.

    Episode k starts as in :func:`jostle.evaluate`: the same start, goal, pedestrians and noise on the ranges. ``begin`` tells who
    stands where; then ``observe`` and ``walk`` take turns::

        room = jostle.PeerRoom("SF", n_pedestrians=5)
        episode = room.begin(0)
        ...                                          # put robot and pedestrians there
        row = room.observe(pose, velocity, ranges)   # what the laser measures at the start
        while True:
            v, w = policy(row)
            pedestrians = room.walk()                # where they are at the end of the control period
            ...                                      # move everybody for ``dt`` seconds
            ...                                      # stop at the goal, at a crash, after ``step_limit`` steps
            row = room.observe(pose, velocity, ranges)

    The other simulator judges goal and crash; ``goal_radius``, ``crash_range`` and ``step_limit`` are the test's. Pedestrians see the robot
    where it was last observed. ``observe`` gives those that have arrived new goals, and those that crashed new places, as
    in the test: ``pedestrians`` then tells where all are.

    Attributes:
        dt: control period (s).
        step_limit: steps after which an episode is cut off.
        goal_radius: a goal is reached below it (m).
        crash_range: the robot has crashed if something is nearer to its centre (m).
        laser_range: the longest range (m).
        beam_angles: ``float64[beams]``, from straight ahead, counter-clockwise (rad).
        limits: the robot's largest v (m/s) and ω (rad/s).
        body: length and width of everybody (m).
        walls: ``float32[2, 2]``, least and largest corner of the room (m).
        obstacles: what else is solid.
        settings_hash: SHA-256 of all settings that decide an episode; a stored cell of ``cargo xtask reproduce`` names it.

    Args:
        respawn_clearance: how far a pedestrian that crashed is put from all others, at least (m); 3 if left out.

    The other keywords are those of :class:`jostle.RoomEnv`.

    Raises:
        ValueError: one line with the setting, what was found and what was expected.
    """

    def __init__(
        self,
        crowd: str = "SF",
        *,
        n_pedestrians: int | None = None,
        robot_visible: bool | None = None,
        pool: Pool | None = None,
        pool_half: Pool | None = None,
        config: StrPath | None = None,
        settings: Mapping[str, Setting] | None = None,
        recording: StrPath | None = None,
        recording_interval: float | None = None,
        recording_gap: float | None = None,
        respawn_clearance: float | None = None,
    ) -> None:
        words = keywords(
            crowd,
            n_pedestrians=n_pedestrians,
            robot_visible=robot_visible,
            pool=pool,
            pool_half=pool_half,
            config=config,
            settings=settings,
            recording=recording,
            recording_interval=recording_interval,
            recording_gap=recording_gap,
        )
        core = self._core = _jostle.PeerRoom(words, respawn_clearance)
        warn(_jostle.notes(words, None))
        self.dt, self.step_limit = core.dt, core.step_limit
        self.goal_radius, self.crash_range, self.laser_range = core.goal_radius, core.crash_range, core.laser_range
        self.beam_angles: NDArray[np.float64] = np.array(core.beam_angles)
        v_max, w_max = core.limits
        length, width = core.body
        self.limits, self.body = (v_max, w_max), (length, width)
        self.walls = np.array(core.walls, np.float32)
        self.obstacles = [_obstacle(kind, numbers) for kind, numbers in core.obstacles]
        self.settings_hash = core.settings_hash

    def begin(self, episode: int, *, seed: int = 0) -> dict[str, Any]:
        """Goes to the start of episode ``episode`` of the test of a seed: ``pose`` float32[3] (x, y, heading) and ``goal`` float32[2] of
        the robot, and ``pedestrians`` as :meth:`pedestrians` tells them."""
        index, root = count("episode", episode, least=0), seed_or_none(seed)
        pose, goal, pedestrians = self._core.begin(root or 0, index or 0)
        return {
            "pose": np.array(pose, np.float32),
            "goal": np.array(goal, np.float32),
            "pedestrians": _rows(pedestrians),
        }

    def observe(self, pose: ArrayLike, velocity: ArrayLike, ranges: ArrayLike) -> Float32:
        """The observation row of a robot with this pose (x, y, heading) and velocity (v, ω), whose laser measures these ranges (m, without
        noise, one a beam; what is beyond ``laser_range`` is cut to it). After ``begin`` it is the first of the episode, and the
        robot is where ``begin`` has put it, at rest; else it ends the control period that ``walk`` began."""
        row = np.empty((1, self._core.observation_len), np.float32)
        measured = np.ascontiguousarray(ranges, np.float32).reshape(-1)
        x, y, heading = np.asarray(pose, float)
        v, w = np.asarray(velocity, float)
        self._core.observe((x, y, heading), (v, w), measured, row)
        first: Float32 = row[0]
        return first

    def walk(self) -> Float32:
        """Moves the pedestrians for a control period; where they are then, as :meth:`pedestrians` tells it."""
        return _rows(self._core.walk())

    def pedestrians(self) -> Float32:
        """Who stands where: ``float32[n, 7]``, x, y, heading, velocity x, y, goal x, y."""
        return _rows(self._core.pedestrians())


def _rows(pedestrians: list[list[float]]) -> Float32:
    return np.array(pedestrians, np.float32).reshape(-1, 7)


def _obstacle(kind: str, numbers: list[list[float]]) -> Obstacle:
    found = np.array(numbers, np.float32)
    return Obstacle(kind, found[0] if kind in ("box", "circle") else found)
