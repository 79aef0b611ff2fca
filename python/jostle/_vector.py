"""Many rooms at once: a Gymnasium vector environment that steps all of them in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from . import _jostle
from ._env import Float32, before_reset, image, spaces, state, whereabouts
from ._keywords import (
    Pool,
    Setting,
    StrPath,
    commands,
    count,
    keywords,
    option,
    refusal,
    render_mode_or_none,
    seed_or_none,
    warn,
)


class VectorRooms(VectorEnv[Float32, Float32, NDArray[Any]]):
    """``num_envs`` rooms, each as :class:`jostle.RoomEnv`, stepped on all cores. Room i after ``reset(seed=s)`` is a `RoomEnv` after
    ``reset(seed=s + i)``, to the last bit and at any number of threads (``RAYON_NUM_THREADS``).

    Observations ``float32[B, 1540]``, actions ``float32[B, 2]``, rewards ``float64[B]``.

    A room whose episode ends begins its next one in the same step (``AutoresetMode.SAME_STEP``): its row is the new episode's
    first observation, and ``infos["final_obs"][i]`` and ``infos["final_info"]`` hold the last observation and the information of
    the old one, with outcome and measures. ``infos`` holds ``pose`` float32[B, 3], ``goal`` float32[B, 2] and ``clearance``
    float64[B] in every step.

    The keywords are those of :class:`jostle.RoomEnv`. With ``copy=False`` every step writes into the same arrays, those of
    ``infos`` among them.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
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
        if count("num_envs", num_envs, least=1) is None:
            raise refusal("num_envs", num_envs, "a whole number from 1 on")
        self.render_mode = render_mode_or_none(render_mode)
        self._core = _jostle.CrowdRooms(words, num_envs)
        warn(_jostle.notes(words, None))
        self.beam_angles = np.array(self._core.beam_angles)
        self.metadata = {**type(self).metadata, "render_fps": round(1 / self._core.dt)}
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self._core)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.copy = copy
        self._begun = np.zeros(num_envs, np.bool_)
        self._places, self._clearances = np.zeros((num_envs, 5), np.float32), np.zeros(num_envs)
        self._observations = np.zeros((num_envs, self._core.observation_len), np.float32)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Float32, dict[str, Any]]:
        """Starts an episode in every room, or in those of ``options["reset_mask"]`` (``bool[B]``)."""
        seeds, mask = self._seeds(seed), self._mask(option(options, "reset_mask"))
        chosen = np.flatnonzero(mask).tolist()
        arrays = self._targets()
        for i in chosen:
            one = seeds[i]
            if one is None and self._begun[i]:
                self._core.begin_next(i, *arrays)
            else:
                drawn = int(self.np_random.integers(2**63)) if one is None else one
                self._core.begin(i, drawn, None, *arrays)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
        self._observations, self._places, self._clearances = arrays
        self._begun = self._begun | mask
        return self._observations, self._infos(mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Float32, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Drives every robot for one control period."""
        n = self.num_envs
        if not self._begun.all():
            raise before_reset("step", int(np.argmin(self._begun)))
        driven = commands(actions, (n, 2))
        arrays = observations, places, clearances = self._targets(copied=False)
        rewards, terminated, truncated = np.empty(n, np.float64), np.empty(n, np.bool_), np.empty(n, np.bool_)
        ends = terminated.view(np.uint8), truncated.view(np.uint8)
        ended = self._core.step(driven, observations, rewards, *ends, places, clearances)
        # Only a step that was made reaches what the next reset starts from.
        self._observations, self._places, self._clearances = arrays
        finals: dict[str, Any] = {}
        for i, end in ended:
            final = {**whereabouts(places[i].copy(), clearances[i]), **end}
            finals = self._add_info(finals, {"final_obs": observations[i].copy(), "final_info": final}, i)
            self._core.begin_next(i, *arrays)
        return observations, rewards, terminated, truncated, {**finals, **self._infos()}

    def state(self, i: int) -> dict[str, Any]:
        """As :meth:`jostle.RoomEnv.state`, of room i."""
        i = self._room(i)
        if not self._begun[i]:
            raise before_reset("state", i)
        return state(self._core, i)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """The picture of every room, as :meth:`jostle.RoomEnv.render`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: no render_mode was given; make the environment with render_mode='rgb_array'")
            return None
        if not self._begun.all():
            raise before_reset("render", int(np.argmin(self._begun)))
        return tuple(image(self._core.picture(i)) for i in range(self.num_envs))

    def _room(self, i: int) -> int:
        if count("room", i, least=0) is None or i >= self.num_envs:
            raise refusal("room", i, f"a whole number below {self.num_envs}")
        return int(i)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """One seed for each room, all of them checked."""
        n = self.num_envs
        if seed is None:
            return [None] * n
        if isinstance(seed, (int, np.integer)):
            seed_or_none(seed)
            seed_or_none(int(seed) + n - 1)
            return [int(seed) + i for i in range(n)]
        if isinstance(seed, (str, bytes)) or not isinstance(seed, (Sequence, np.ndarray)):
            raise refusal("seed", seed, f"a whole number, or {n} of them, one for each room")
        if len(seed) != n:
            raise ValueError(f"seed: found {len(seed)} seeds, expected {n}, one for each room")
        return [seed_or_none(one) for one in seed]

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        if not isinstance(mask, np.ndarray):
            raise refusal("reset_mask", mask, f"an array bool({self.num_envs},)")
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"reset_mask: found {mask.dtype}{mask.shape}, expected bool({self.num_envs},)")
        return mask.copy()

    def _targets(self, copied: bool = True) -> tuple[Float32, Float32, NDArray[np.float64]]:
        """The arrays that the next call fills: the same again, or new ones, so that the old stay with whoever holds them; copied
        where not every row is going to be written."""
        arrays = self._observations, self._places, self._clearances
        if not self.copy:
            return arrays
        observations, places, clearances = arrays
        if copied:
            return observations.copy(), places.copy(), clearances.copy()
        return np.empty_like(observations), np.empty_like(places), np.empty_like(clearances)

    def _infos(self, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Where the robots stand, as Gymnasium's vectors put it: an array for each key, and one that says which rooms have it."""
        infos: dict[str, Any] = {}
        told: dict[str, NDArray[Any]] = {"pose": self._places[:, :3], "goal": self._places[:, 3:], "clearance": self._clearances}
        if mask is None:
            mask = np.ones(self.num_envs, np.bool_)
        elif not mask.all():
            told = {key: np.where(mask.reshape(-1, *[1] * (values.ndim - 1)), values, 0) for key, values in told.items()}
        for key, values in told.items():
            infos[key], infos[f"_{key}"] = values, mask
        return infos
