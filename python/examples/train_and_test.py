"""Trains PPO in a room of social-force pedestrians and tests it among ORCA's: `pip install stable-baselines3`."""

import sys

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import jostle

steps, episodes = (int(word) for word in sys.argv[1:] or (200_000, 200))
rooms = make_vec_env("jostle/Room-v0", n_envs=4, seed=0, env_kwargs={"crowd": "SF", "n_pedestrians": 2})
model = PPO("MlpPolicy", rooms, n_steps=256, batch_size=256, device="cpu", verbose=1)
model.learn(total_timesteps=steps)


def act(observations):
    return model.predict(observations, deterministic=True)[0]


for crowd in ("SF", "VO"):
    print(jostle.evaluate(act, crowd, episodes=episodes, name="PPO"))
