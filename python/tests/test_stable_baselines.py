"""Stable-Baselines3 trains on a room, and what it trained is tested."""

from __future__ import annotations

import warnings

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor

import jostle


def test_ppo_trains_and_is_tested() -> None:
    torch.set_num_threads(1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It asks for action spaces from −1 to 1; those of jostle are in m/s and rad/s.
        warnings.filterwarnings("ignore", message="We recommend you to use a symmetric and normalized Box action space")
        check_env(jostle.RoomEnv("SF"))
    env = Monitor(jostle.RoomEnv("SF", n_pedestrians=2), info_keywords=("is_success",))
    model = PPO("MlpPolicy", env, n_steps=512, batch_size=128, n_epochs=3, seed=0, device="cpu")
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(total_timesteps=4096)
    assert model.num_timesteps == 4096
    assert len(env.get_episode_rewards()) > 5
    assert all(torch.isfinite(parameter).all() for parameter in model.policy.parameters())
    moved = [not torch.equal(old, new) for old, new in zip(before, model.policy.parameters(), strict=True)]
    assert all(moved)

    def act(observations: np.ndarray) -> np.ndarray:
        return model.predict(observations, deterministic=True)[0]

    found = jostle.evaluate(act, "SF", episodes=20, n_pedestrians=2)
    assert found.episodes == 20
    assert found == jostle.evaluate(act, "SF", episodes=20, n_pedestrians=2)


def test_its_maker_of_vectors_takes_rooms_by_their_name() -> None:
    rooms = make_vec_env("jostle/Room-v0", n_envs=2, seed=0, env_kwargs={"crowd": "VO"})
    observations = rooms.reset()
    assert observations.shape == (2, 1540) and not np.array_equal(observations[0], observations[1])
