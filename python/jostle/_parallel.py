"""Several robots in one room: a PettingZoo parallel environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from numpy.typing import ArrayLike
from pettingzoo import ParallelEnv

from . import _jostle
from ._env import Float32, spaces
from ._keywords import Setting, StrPath, count, overrides, path_or_none


class RobotsEnv(ParallelEnv[str, Float32, Float32]):
    """Robots that are each other's crowd, as in training. See :func:`jostle.parallel_env`."""

    metadata: ClassVar[dict[str, Any]] = {"name": "jostle_robots_v0", "render_modes": [], "is_parallelizable": True}

    def __init__(
        self,
        n_agents: int | None = None,
        *,
        n_behaviours: int = 1,
        observe_token: bool = False,
        config: StrPath | None = None,
        settings: Mapping[str, Setting] | None = None,
    ) -> None:
        if not 1 <= n_behaviours < 2**32:
            raise ValueError(f"n_behaviours: found {n_behaviours}, expected a whole number from 1 on")
        count("n_agents", n_agents, least=1)
        self._core = _jostle.RobotRoom(path_or_none(config), overrides(settings), n_agents, n_behaviours)
        self.beam_angles = np.array(self._core.beam_angles)
        self.render_mode = None
        self.possible_agents = [f"robot_{i}" for i in range(self._core.n_agents)]
        self.agents: list[str] = []
        observation, action = spaces(self._core)
        width = self._core.observation_len
        self._n_tokens = n_behaviours if observe_token else 0
        low, high = np.zeros(self._n_tokens, np.float32), np.ones(self._n_tokens, np.float32)
        low, high = np.concatenate([observation.low, low]), np.concatenate([observation.high, high])
        self.observation_spaces = {agent: Box(low, high, dtype=np.float32) for agent in self.possible_agents}
        self.action_spaces = {agent: Box(action.low, action.high, dtype=np.float32) for agent in self.possible_agents}
        self._index = {agent: i for i, agent in enumerate(self.possible_agents)}
        self._shape = (len(self.possible_agents), width)
        self._tokens: list[int] = []
        self._random: np.random.Generator | None = None

    def observation_space(self, agent: str) -> Box:
        """The same object in every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """The same object in every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Float32], dict[str, dict[str, Any]]]:
        """Places all robots anew; without a seed, by the next draw of the last one."""
        if seed is not None or self._random is None:
            self._random, _ = seeding.np_random(seed)
        observations = np.empty(self._shape, np.float32)
        self._tokens = self._core.begin(int(self._random.integers(2**63)), observations)
        self.agents = list(self.possible_agents)
        return self._rows(observations, self.agents), {agent: self._info(agent, {}) for agent in self.agents}

    def step(
        self, actions: Mapping[str, ArrayLike]
    ) -> tuple[
        dict[str, Float32], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Drives every robot that is there for one control period."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"actions: found none for {missing[0]}, expected one for each of {', '.join(self.agents)}")
        commands = np.zeros((self._shape[0], 2), np.float32)
        for agent in self.agents:
            commands[self._index[agent]] = actions[agent]
        observations = np.empty(self._shape, np.float32)
        there, self.agents = self.agents, []
        rewards, terminated, truncated, infos = {}, {}, {}, {}
        for i, reward, terminates, truncates, info in self._core.step(commands, observations):
            agent = self.possible_agents[i]
            rewards[agent], terminated[agent], truncated[agent] = reward, terminates, truncates
            infos[agent] = self._info(agent, info)
            if not (terminates or truncates):
                self.agents.append(agent)
        return self._rows(observations, there), rewards, terminated, truncated, infos

    def _rows(self, observations: Float32, agents: list[str]) -> dict[str, Float32]:
        if self._n_tokens:
            one_hot = np.eye(self._n_tokens, dtype=np.float32)[self._tokens]
            observations = np.concatenate([observations, one_hot], axis=1)
        return {agent: observations[self._index[agent]] for agent in agents}

    def _info(self, agent: str, info: dict[str, Any]) -> dict[str, Any]:
        return {"token": self._tokens[self._index[agent]], **info}
