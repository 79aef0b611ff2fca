"""One robot among a crowd: a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from . import _jostle
from ._keywords import (
    Pool,
    Setting,
    StrPath,
    commands,
    count,
    keywords,
    option,
    render_mode_or_none,
    seed_or_none,
    warn,
)

Float32 = NDArray[np.float32]


def spaces(core: _jostle.CrowdRooms | _jostle.RobotRoom) -> tuple[Box[np.float32], Box[np.float32]]:
    """The spaces of one robot's observation and action."""
    low, high = (np.array(bound, np.float32) for bound in core.bounds())
    limits = np.array(core.limits, np.float32)
    least = limits * np.array([0, -1], np.float32)
    return Box(low, high, dtype=np.float32), Box(least, limits, dtype=np.float32)


def state(core: _jostle.CrowdRooms, i: int) -> dict[str, Any]:
    """Who stands where in room i, as arrays."""
    found = core.state(i)
    found["pedestrians"] = np.array(found["pedestrians"], np.float32).reshape(-1, 7)
    return {key: np.array(value, np.float32) if isinstance(value, list) else value for key, value in found.items()}


def whereabouts(place: Float32, clearance: float) -> dict[str, Any]:
    """What every information holds: pose (x, y, heading), goal (x, y) and clearance."""
    return {"pose": place[:3], "goal": place[3:], "clearance": float(clearance)}


def image(pixels: tuple[int, int, bytes]) -> NDArray[np.uint8]:
    """A picture of Rust's as an array of its own."""
    height, width, rgb = pixels
    return np.frombuffer(bytearray(rgb), np.uint8).reshape(height, width, 3)


def before_reset(what: str, room: int = 0) -> ValueError:
    """The refusal of what needs an episode."""
    return ValueError(f"{what}: found no episode in room {room}, expected a reset before it")


class RoomEnv(gymnasium.Env[Float32, Float32]):
    """A robot with a 2D laser crosses a room full of people.

    Observation: ``float32[1540]``, three scans of 512 beams, oldest first, each range/10 − 0.5 with the first beam straight
    ahead and counter-clockwise from there; then the goal in the robot's frame (x forward, y left, m); then v (m/s) and
    ω (rad/s). :func:`jostle.split` names the parts.

    A laser that does not see all round is set by ``settings={"sim.laser.fov": 4.712, "sim.laser.angle_min": -2.356}``
    (radians: 270° centred ahead). Its first and last beam lie on the sector's edges, and no beam exists outside. With
    ``sim.laser.beams`` = n the observation is ``float32[3·n + 4]``. :attr:`beam_angles` says where each beam points.

    Attributes:
        beam_angles: ``float64[beams]``, the angle of each beam from straight ahead, counter-clockwise (rad).

    Action: ``float32[2]``, v in [0, 1] m/s and ω in [−1, 1] rad/s for 0.1 s; what is beyond is clipped.

    Reward: +15 at the goal (nearer than 0.5 m), −15 at a crash (something nearer than 0.5 m, all round), else 2.5 times the metres gained; less
    0.1·|ω| where |ω| > 0.7 rad/s. Goal and crash terminate, 400 steps truncate.

    Information: ``pose`` float32[3] (x, y in metres, heading in radians, in the world), ``goal`` float32[2] (in the world, m) and
    ``clearance``, the distance from the robot's outline to the nearest pedestrian, obstacle or wall (m; 0 where it touches one).
    That of an episode's last step also holds ``outcome`` (success, collision_wall, collision_pedestrian, timeout), ``is_success``,
    ``episode_index`` and the measures of the test: ``steps``, ``time`` (s), ``path_length`` and ``straight_distance`` (m),
    ``extra_time`` (s), ``extra_distance`` (m) and ``average_speed`` (m/s), which are NaN unless it succeeded; and
    ``min_clearance`` (m), the least of the episode.

    The same seed gives the same bytes. Episodes that one trains in are never those of :func:`jostle.evaluate`;
    ``reset(seed=s, options={"test_episode": k})`` goes to episode k of its test with seed s (0 if there is none).

    A call that is refused changes nothing. ``copy.deepcopy`` and ``pickle`` give an environment that goes on where this one is, bit
    for bit; a pickle holds the paths of the files that it was made from, and is refused where they have changed.

    Args:
        crowd: NH, IN, VA, SO (these need ``pool``), VO or SF; straight, stop-and-go or (with ``pool``) cross-play; or recorded, which
            needs ``recording``.
        n_pedestrians: how many walk about; those of the configuration (4) if left out.
        robot_visible: whether pedestrians see the robot; the crowd's own rule if left out.
        pool: policies that drive learned pedestrians: checkpoint files, run folders, or folders of either.
        pool_half: the same at half their training, for SO; if left out, those that the runs of ``pool`` have kept.
        config: a TOML file as ``cargo xtask train`` reads it, of which the simulator is taken.
        settings: keys of it by their dotted names, such as ``{"sim.laser.noise_std": 0.0}``.
        recording: people who walked somewhere, for crowd recorded: a file of ETH's ``obsmat.txt``, of ``frame id x y`` or of trajnet++
            (docs/how-to-recorded.md). The room is the one around them, and nothing that the robot does moves them.
        recording_interval: seconds between two frames of a person; what the file says, else 0.4, if left out.
        recording_gap: the longest gap in a person's frames that is bridged (s); none if left out.
        copy: whether every step returns an array of its own. If not, all return the same one, and the next step
            overwrites it.
        render_mode: ``rgb_array`` for :meth:`render` to give the room from above as an image, uint8[height, width, 3].

    Raises:
        ValueError: one line with the setting, what was found and what was expected.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

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
        copy: bool = True,
        render_mode: str | None = None,
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
        self.render_mode = render_mode_or_none(render_mode)
        self._core = _jostle.CrowdRooms(words, 1)
        warn(_jostle.notes(words, None))
        self.beam_angles = np.array(self._core.beam_angles)
        self.metadata = {**type(self).metadata, "render_fps": round(1 / self._core.dt)}
        self.observation_space, self.action_space = spaces(self._core)
        self.copy = copy
        self._begun = self._seeded = False
        self._observations = np.zeros((1, self._core.observation_len), np.float32)
        self._reward, self._ends = np.zeros(1, np.float64), np.zeros((2, 1), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """Starts an episode: the first of a seed, the next of the present one, or an episode of the test."""
        seed = seed_or_none(seed)
        episode = count("test_episode", option(options, "test_episode"), least=0)
        arrays = observations, place, clearance = self._target(), np.empty((1, 5), np.float32), np.empty(1)
        if episode is not None:
            self._core.begin(0, seed or 0, episode, *arrays)
        elif seed is not None or not self._seeded:
            self._core.begin(0, int(self.np_random.integers(2**63)) if seed is None else seed, None, *arrays)
        else:
            self._core.begin_next(0, *arrays)
        super().reset(seed=seed)
        # After an episode of the test, the next of its seed would be the test's, too.
        self._begun, self._seeded = True, episode is None
        return observations[0], whereabouts(place[0], clearance[0])

    def step(self, action: ArrayLike) -> tuple[Float32, float, bool, bool, dict[str, Any]]:
        """Drives for one control period."""
        if not self._begun:
            raise before_reset("step")
        actions = commands(action, (2,)).reshape(1, 2)
        observations, (terminated, truncated) = self._target(), self._ends
        place, clearance = np.empty((1, 5), np.float32), np.empty(1)
        ended = self._core.step(actions, observations, self._reward, terminated, truncated, place, clearance)
        info = whereabouts(place[0], clearance[0])
        for _, end in ended:
            info.update(end)
        return observations[0], float(self._reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def state(self) -> dict[str, Any]:
        """Who stands where, in world coordinates: ``robot`` float32[7] and ``pedestrians`` float32[n, 7] (x, y, heading, velocity
        x, y, goal x, y; of recorded people those who are there), ``ranges`` float32[beams] without noise (m), ``episode_index``. For plots and for critics that may know more
        than the robot."""
        if not self._begun:
            raise before_reset("state")
        return state(self._core, 0)

    def render(self) -> NDArray[np.uint8] | None:
        """The room from above, y up: the robot red with its goal, pedestrians blue, obstacles and walls grey; the longer side has
        480 pixels and the walls. ``None``, with a warning of Gymnasium's, unless ``render_mode`` was given."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: no render_mode was given; make the environment with render_mode='rgb_array'")
            return None
        if not self._begun:
            raise before_reset("render")
        return image(self._core.picture(0))

    def _target(self) -> Float32:
        return np.empty_like(self._observations) if self.copy else self._observations
