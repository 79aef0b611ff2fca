"""Many rooms at once: a Gymnasium vector environment that steps all of them in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from . import _jostle
from ._env import Float32, spaces, state
from ._keywords import Pool, Setting, StrPath, count, keywords


class VectorRooms(VectorEnv[Float32, Float32, NDArray[Any]]):
    """``num_envs`` rooms, each as :class:`jostle.RoomEnv`, stepped on all cores. Room i after ``reset(seed=s)`` is a `RoomEnv` after
    ``reset(seed=s + i)``, to the last bit and at any number of threads (``RAYON_NUM_THREADS``).

    Observations ``float32[B, 1540]``, actions ``float32[B, 2]``, rewards ``float64[B]``.

    A room whose episode ends begins its next one in the same step (``AutoresetMode.SAME_STEP``): its row is the new episode's
    first observation, and ``infos["final_obs"][i]`` and ``infos["final_info"]`` hold the last observation and the outcome of the
    old one.

    The keywords are those of :class:`jostle.RoomEnv`. With ``copy=False`` every step writes into the same array.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        crowd: str = "SF",
        *,
        n_pedestrians: int | None = None,
        robot_visible: bool | None = None,
        pool: Pool | None = None,
        config: StrPath | None = None,
        settings: Mapping[str, Setting] | None = None,
        copy: bool = True,
    ) -> None:
        words = keywords(
            crowd,
            n_pedestrians=n_pedestrians,
            robot_visible=robot_visible,
            pool=pool,
            config=config,
            settings=settings,
        )
        count("num_envs", num_envs, least=1)
        self._core = _jostle.CrowdRooms(words, num_envs)
        self.beam_angles = np.array(self._core.beam_angles)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self._core)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = None
        self.copy = copy
        self._seeded = np.zeros(num_envs, np.bool_)
        self._observations = np.zeros((num_envs, self._core.observation_len), np.float32)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Float32, dict[str, Any]]:
        """Starts an episode in every room, or in those of ``options["reset_mask"]`` (``bool[B]``)."""
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
            seeds: list[int | None] = [int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}, one for each room")
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(f"reset_mask: found {mask.dtype}{mask.shape}, expected bool({self.num_envs},)")
        if self.copy:
            # The old array stays with whoever holds it.
            self._observations = self._observations.copy()
        for i in np.flatnonzero(mask).tolist():
            chosen = seeds[i]
            if chosen is None and self._seeded[i]:
                self._core.begin_next(i, self._observations)
                continue
            if chosen is None:
                chosen = int(self.np_random.integers(2**63))
            self._core.begin(i, count("seed", chosen, least=0), None, self._observations)
            self._seeded[i] = True
        return self._observations, {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Float32, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Drives every robot for one control period."""
        n = self.num_envs
        if self.copy:
            # As above; Rust writes every row of the new one.
            self._observations = np.empty_like(self._observations)
        rewards, terminated, truncated = np.empty(n, np.float64), np.empty(n, np.bool_), np.empty(n, np.bool_)
        commands = np.ascontiguousarray(actions, np.float32)
        ends = terminated.view(np.uint8), truncated.view(np.uint8)
        infos: dict[str, Any] = {}
        for i, info in self._core.step(commands, self._observations, rewards, *ends):
            infos = self._add_info(infos, {"final_obs": self._observations[i].copy(), "final_info": info}, i)
            self._core.begin_next(i, self._observations)
        return self._observations, rewards, terminated, truncated, infos

    def state(self, i: int) -> dict[str, Any]:
        """As :meth:`jostle.RoomEnv.state`, of room i."""
        return state(self._core, i)
