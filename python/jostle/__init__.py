"""Robots with 2D lasers among people: environments to train in, and a test among six crowds.

- :class:`RoomEnv`: one robot among a crowd, for Gymnasium.
- :class:`VectorRooms`: many such rooms, stepped in one call on all cores.
- :func:`parallel_env`: several robots in one room, for PettingZoo.
- :func:`evaluate`: any policy in the test's episodes, with intervals.
- :class:`PeerRoom`: the test's episodes for a robot that another simulator moves.
- :func:`leaderboard_entry`: any policy on the leaderboard's scenes, as an entry of it.
- :class:`Policy`: a policy that jostle trained.
- :func:`planner`: a robot that nobody trained, by its name.
- :func:`scan_to_row`: from a robot's own numbers to the row that a policy reads.
- :func:`write_policy`: a network of PyTorch as a policy's file.

Mistakes are `ValueError`\\ s of one line: the setting, what was found, what was expected.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ._convert import write_policy
from ._env import RoomEnv
from ._evaluation import Evaluation, evaluate
from ._jostle import __version__
from ._leaderboard import leaderboard_entry
from ._keywords import Setting, StrPath
from ._peer import Obstacle, PeerRoom
from ._planner import PLANNERS, Planner, planner
from ._policy import Policy
from ._scan import scan_to_row
from ._vector import VectorRooms

if TYPE_CHECKING:
    from ._parallel import RobotsEnv

__all__ = [
    "CROWDS",
    "PLANNERS",
    "VALIDATION_CROWDS",
    "Evaluation",
    "Obstacle",
    "PeerRoom",
    "Planner",
    "Policy",
    "RoomEnv",
    "VectorRooms",
    "__version__",
    "evaluate",
    "leaderboard_entry",
    "parallel_env",
    "planner",
    "scan_to_row",
    "split",
    "write_policy",
]

#: The crowds: NH, IN, VA and SO are driven by policies, VO by ORCA, SF by social forces.
CROWDS = ("NH", "IN", "VA", "SO", "VO", "SF")

#: Crowds to choose settings by, in no table of the paper: walkers who see nobody, and, driven by the policies of ``pool``, cross-play.
VALIDATION_CROWDS = ("straight", "stop-and-go", "cross-play")


def parallel_env(
    n_agents: int | None = None,
    *,
    n_behaviours: int = 1,
    observe_token: bool = False,
    config: StrPath | None = None,
    settings: Mapping[str, Setting] | None = None,
    render_mode: str | None = None,
) -> RobotsEnv:
    """Several robots in one room, each other's crowd as in training: a PettingZoo ``ParallelEnv``.

    Observations, actions and rewards are those of :class:`RoomEnv`. Each robot has its own episode: at its goal or a crash
    it terminates, after 400 steps it is truncated. It then leaves ``agents`` and the room, body and all, and the others go on
    until the last has left. (In jostle's own training it would be placed anew at once; PettingZoo does not let an agent come
    back.) A reset begins all episodes together.

    ``infos[agent]`` holds ``token``, ``pose``, ``goal`` and ``clearance`` (to robots, obstacles and walls), and at the end of its
    episode ``outcome`` (success, collision_wall, collision_agent, timeout), ``is_success`` and the measures, as in
    :class:`RoomEnv`. A call that is refused changes nothing; ``copy.deepcopy`` and ``pickle`` go on bit for bit.

    Args:
        n_agents: robots in the room; those of the configuration (5) if left out.
        n_behaviours: M. Each robot draws a behaviour token below it for every episode: ``infos[agent]["token"]``.
        observe_token: whether the token also stands at the end of the observation, as M numbers of which one is 1.
        config: a TOML file as ``cargo xtask train`` reads it, of which the simulator is taken.
        settings: keys of it by their dotted names.
        render_mode: ``rgb_array`` for ``render()`` to give the room from above, uint8[height, width, 3].

    Raises:
        ImportError: without PettingZoo (``pip install 'jostle[pettingzoo]'``).
        ValueError: one line with the setting, what was found and what was expected.
    """
    from ._parallel import RobotsEnv

    return RobotsEnv(
        n_agents,
        n_behaviours=n_behaviours,
        observe_token=observe_token,
        config=config,
        settings=settings,
        render_mode=render_mode,
    )


def split(
    observations: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """The parts of observations ``[…, 3·beams + 4]``, as views: scans ``[…, 3, beams]`` (oldest first, range/10 − 0.5, beams
    pointing to ``env.beam_angles``), goal ``[…, 2]`` in the robot's frame (m), velocity ``[…, 2]`` (m/s, rad/s)."""
    scans, goal, velocity = observations[..., :-4], observations[..., -4:-2], observations[..., -2:]
    return scans.reshape(*scans.shape[:-1], 3, -1), goal, velocity


gymnasium.register("jostle/Room-v0", entry_point="jostle:RoomEnv", vector_entry_point="jostle:VectorRooms")
