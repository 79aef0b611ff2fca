"""The test: a policy in the same episodes as every other, among a crowd that it never met."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _jostle
from ._env import Float32
from ._keywords import Pool, Setting, StrPath, count, keywords, seed_or_none, warn
from ._planner import Planner
from ._policy import Policy

Robot = Union[Callable[[Float32], ArrayLike], Policy, Planner]


@dataclass(frozen=True)
class Evaluation:
    """What a test found. Times are in seconds, distances in metres, speeds in m/s; means and sample standard deviations are
    taken over the successes and are ``None`` where there are too few."""

    name: str
    crowd: str
    n_agents: int
    seed: int
    episodes: int
    success: int
    collision_wall: int
    collision_pedestrian: int
    timeout: int
    success_rate: float
    #: 95 % Wilson interval of the success rate.
    wilson_95: tuple[float, float]
    #: (mean, sample standard deviation).
    extra_time: tuple[float | None, float | None]
    extra_distance: tuple[float | None, float | None]
    average_speed: tuple[float | None, float | None]
    #: How the robot drove, by the names of ``docs/metrics.md``: ``spl``, ``path_efficiency``, ``time_efficiency``, ``min_clearance``,
    #: ``min_clearance_tail``, ``ttc_below`` (1 s and 2 s), ``intimate``, ``personal``, ``mean_squared_jerk``, ``stalled_time``,
    #: ``deadlocks``.
    driving: dict[str, Any]
    #: One dictionary for each episode, in order, as the records that `cargo xtask evaluate` writes.
    records: list[dict[str, Any]] = field(repr=False)

    def __str__(self) -> str:
        low, high = self.wilson_95
        return (
            f"{self.name} in {self.crowd}: success {self.success_rate:.3f} ({low:.3f}–{high:.3f}) of {self.episodes} episodes, "
            f"hit wall {self.collision_wall}, hit pedestrian {self.collision_pedestrian}, timeout {self.timeout}"
        )


def evaluate(
    fn: Robot,
    crowd: str = "SF",
    *,
    episodes: int = 1000,
    seed: int = 0,
    n_pedestrians: int | None = None,
    robot_visible: bool | None = None,
    pool: Pool | None = None,
    pool_half: Pool | None = None,
    config: StrPath | None = None,
    settings: Mapping[str, Setting] | None = None,
    recording: StrPath | None = None,
    recording_interval: float | None = None,
    recording_gap: float | None = None,
    batch: int = 256,
    name: str | None = None,
) -> Evaluation:
    """Tests a policy by the protocol of ``cargo xtask evaluate``: the same episodes, outcomes and figures.

    Args:
        fn: a function of observations ``float32[B, 1540]`` that answers with actions ``[B, 2]`` (v in m/s, ω in rad/s; clipped),
            or a :class:`jostle.Policy` or :func:`jostle.planner`, which are tested without a way through Python. B changes from call to call, and rows
            belong to different episodes: an action must be a function of its own row alone. The array is written anew for
            every call; copy what is to be kept. A policy with a memory is tested by
            ``RoomEnv.reset(options={"test_episode": k})``.
        crowd: NH, IN, VA, SO (these need ``pool``), VO or SF; straight, stop-and-go or (with ``pool``) cross-play; or recorded, which
            needs ``recording``.
        episodes: episodes 0 up to this; episode k is the same for every policy.
        seed: root seed of starts, goals, noise and pedestrians.
        batch: the most episodes that run side by side. Changes speed and memory alone.
        name: what to call the policy.

    The other keywords are those of :class:`jostle.RoomEnv`. For a `Policy`, simulator and number of pedestrians are those of
    its training, for a `Planner` those that it was made for: ``settings`` changes keys of them, ``config`` replaces them. A
    `Policy` whose laser pointed elsewhere in training is refused.

    Raises:
        ValueError: one line with what was found and what was expected.
        Exception: whatever ``fn`` raises.
    """
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
    count("episodes", episodes, least=1)
    count("batch", batch, least=1)
    seed_or_none(seed)
    warn(_jostle.notes(words, fn.core if isinstance(fn, Policy) else None))
    if isinstance(fn, Policy):
        found = _jostle.evaluate_policy(fn.core, words, episodes, seed, batch)
        called = fn.name
    elif isinstance(fn, Planner):
        found = _jostle.evaluate_planner(fn.core, words, episodes, seed, batch)
        called = fn.name
    else:
        called = str(getattr(fn, "__name__", type(fn).__name__))
        found = _jostle.evaluate(_rows(fn), _zeros, name or called, words, episodes, seed, batch)
    result, records, n_agents = found
    found_result = json.loads(result)
    summary = found_result["summary"]
    interval = summary["wilson_95"]
    return Evaluation(
        name=name or called,
        crowd=crowd,
        n_agents=n_agents,
        seed=seed,
        episodes=summary["episodes"],
        success=summary["success"],
        collision_wall=summary["collision_wall"],
        collision_pedestrian=summary["collision_pedestrian"],
        timeout=summary["timeout"],
        success_rate=summary["success_rate"],
        wilson_95=(interval["low"], interval["high"]),
        extra_time=_mean_and_std(summary["extra_time"]),
        extra_distance=_mean_and_std(summary["extra_distance"]),
        average_speed=_mean_and_std(summary["average_speed"]),
        driving=found_result["driving"],
        records=json.loads(records),
    )


def _rows(fn: Callable[[Float32], ArrayLike]) -> Callable[[Float32, int], Float32]:
    """The function as Rust calls it: with an array of which the first n rows are to be answered."""

    def act(observations: Float32, n: int) -> Float32:
        return np.ascontiguousarray(fn(observations[:n]), np.float32)

    return act


def _zeros(shape: tuple[int, int]) -> Float32:
    return np.zeros(shape, np.float32)


def _mean_and_std(found: dict[str, float | None]) -> tuple[float | None, float | None]:
    return found["mean"], found["std"]
