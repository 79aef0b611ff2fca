"""Several robots in one room: a PettingZoo parallel environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Space
from gymnasium.utils import seeding
from numpy.typing import ArrayLike, NDArray
from pettingzoo import ParallelEnv

from . import _jostle
from ._env import Float32, image, spaces, whereabouts
from ._keywords import (
    Setting,
    StrPath,
    commands,
    count,
    option,
    overrides,
    path_or_none,
    refusal,
    render_mode_or_none,
    seed_or_none,
    warn,
)


class RobotsEnv(ParallelEnv[str, Float32, Float32]):
    """Robots that are each other's crowd, as in training. See :func:`jostle.parallel_env`."""

    metadata: dict[str, Any] = {
        "name": "jostle_robots_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        n_agents: int | None = None,
        *,
        n_behaviours: int = 1,
        observe_token: bool = False,
        config: StrPath | None = None,
        settings: Mapping[str, Setting] | None = None,
        render_mode: str | None = None,
    ) -> None:
        if (count("n_behaviours", n_behaviours, least=1) or 2**32) >= 2**32:
            raise refusal("n_behaviours", n_behaviours, f"a whole number from 1 to {2**32 - 1}")
        count("n_agents", n_agents, least=1)
        self.render_mode = render_mode_or_none(render_mode)
        self._core = _jostle.RobotRoom(path_or_none("config", config), overrides(settings), n_agents, n_behaviours)
        warn(self._core.notes())
        self.beam_angles = np.array(self._core.beam_angles)
        self.metadata = {**type(self).metadata, "render_fps": round(1 / self._core.dt)}
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

    def observation_space(self, agent: str) -> Space[Float32]:
        """The same object in every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Float32]:
        """The same object in every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Float32], dict[str, dict[str, Any]]]:
        """Places all robots anew; without a seed, by the next draw of the last one. There are no options; the entry ``options`` of
        PettingZoo's own tests is passed over."""
        seed = seed_or_none(seed)
        option(options, None, passed_over="options")
        random = self._random if seed is None else None
        if random is None:
            random, _ = seeding.np_random(seed)
        observations = np.empty(self._shape, np.float32)
        self._tokens = self._core.begin(int(random.integers(2**63)), observations)
        self._random, self.agents = random, list(self.possible_agents)
        stands = self._core.whereabouts()
        infos = {agent: self._info(agent, stands[self._index[agent]], {}) for agent in self.agents}
        return self._rows(observations, self.agents), infos

    def step(
        self, actions: Mapping[str, ArrayLike]
    ) -> tuple[
        dict[str, Float32], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Drives every robot that is there for one control period; actions of robots that have left are not looked at."""
        if self._random is None:
            raise ValueError("step: found no episode, expected a reset before it")
        driven = self._commands(actions)
        if not self.agents:
            return {}, {}, {}, {}, {}
        observations = np.empty(self._shape, np.float32)
        steps, stands = self._core.step(driven, observations), self._core.whereabouts()
        # Only a step that was made changes who is there.
        there, self.agents = self.agents, []
        rewards, terminated, truncated, infos = {}, {}, {}, {}
        for i, reward, terminates, truncates, info in steps:
            agent = self.possible_agents[i]
            rewards[agent], terminated[agent], truncated[agent] = reward, terminates, truncates
            infos[agent] = self._info(agent, stands[i], info)
            if not (terminates or truncates):
                self.agents.append(agent)
        return self._rows(observations, there), rewards, terminated, truncated, infos

    def render(self) -> NDArray[np.uint8] | None:
        """The room from above, uint8[height, width, 3], each robot that is there with its goal in a colour of its own."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: no render_mode was given; make the environment with render_mode='rgb_array'")
            return None
        if self._random is None:
            raise ValueError("render: found no episode, expected a reset before it")
        return image(self._core.picture())

    def _commands(self, actions: Mapping[str, ArrayLike]) -> Float32:
        """One row for each robot; those that have left keep zeros."""
        if not isinstance(actions, Mapping):
            raise refusal("actions", actions, "a dictionary with one for each robot")
        for agent in actions:
            if agent not in self._index:
                raise refusal("actions", agent, f"robots among {', '.join(self.possible_agents)}")
        driven = np.zeros((self._shape[0], 2), np.float32)
        for agent in self.agents:
            if agent not in actions:
                raise ValueError(f"actions: found none for {agent}, expected one for each of {', '.join(self.agents)}")
            try:
                driven[self._index[agent]] = commands(actions[agent], (2,))
            except ValueError as error:
                raise ValueError(f"{agent}: {error}") from None
        return driven

    def _rows(self, observations: Float32, agents: list[str]) -> dict[str, Float32]:
        if self._n_tokens:
            one_hot = np.eye(self._n_tokens, dtype=np.float32)[self._tokens]
            observations = np.concatenate([observations, one_hot], axis=1)
        return {agent: observations[self._index[agent]] for agent in agents}

    def _info(self, agent: str, stands: tuple[list[float], float], info: dict[str, Any]) -> dict[str, Any]:
        place, clearance = stands
        token = self._tokens[self._index[agent]]
        return {"token": token, **whereabouts(np.array(place, np.float32), clearance), **info}
