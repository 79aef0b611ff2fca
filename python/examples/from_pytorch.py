"""Makes a policy of a PyTorch network and tests it: `python from_pytorch.py [STATE_DICT.pt] [OUT.safetensors]`.

Without a file the network has the weights that PyTorch gives it.
"""

import sys

import torch
from torch import nn

import jostle


class Actor(nn.Module):
    """The paper's actor: a row of 3·beams + 4 numbers and a behaviour token give v and ω."""

    def __init__(self, n_behaviours=1, beams=512, frames=3, embedding=32):
        super().__init__()
        length = ((beams - 3) // 2 + 1 - 1) // 2 + 1
        self.frames, self.beams = frames, beams
        self.conv1 = nn.Conv1d(frames, 32, 5, stride=2, padding=1)
        self.conv2 = nn.Conv1d(32, 32, 3, stride=2, padding=1)
        self.fc1 = nn.Linear(32 * length, 256)
        self.embedding = nn.Embedding(n_behaviours, embedding)
        self.fc2 = nn.Linear(256 + 4 + embedding, 128)
        self.mean_v, self.mean_w = nn.Linear(128, 1), nn.Linear(128, 1)
        self.log_std = nn.Parameter(torch.zeros(2))

    def forward(self, rows, tokens):
        scans, goal_and_velocity = rows[:, :-4], rows[:, -4:]
        laser = scans.reshape(-1, self.frames, self.beams)
        laser = torch.relu(self.conv2(torch.relu(self.conv1(laser))))
        feature = torch.relu(self.fc1(laser.flatten(1)))
        hidden = torch.relu(self.fc2(torch.cat([feature, goal_and_velocity, self.embedding(tokens)], 1)))
        return torch.cat([torch.sigmoid(self.mean_v(hidden)), torch.tanh(self.mean_w(hidden))], 1)


if __name__ == "__main__":
    source, target = (*sys.argv[1:], None, None)[:2]
    actor = Actor()
    if source:
        actor.load_state_dict(torch.load(source, weights_only=True))
    jostle.write_policy(target or "from_pytorch.safetensors", actor.state_dict())
    print(jostle.evaluate(jostle.Policy(target or "from_pytorch.safetensors"), crowd="SF", episodes=100))
