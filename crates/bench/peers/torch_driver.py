"""Work U and the actor's inference in PyTorch, eager, on the CPU: `torch_driver.py update|forward-B THREADS`.

Work U: 640 transitions in one full batch; three epochs each of actor, critic and both discriminators: forward, backward
and Adam; the loss is the mean of the squared outputs. The networks are the paper's: two convolutions over three scans of
512 beams, 256 units, the goal, the velocity and the behaviour's embedding joined, 128 units.
"""

import sys

import torch
from torch import nn

from rounds import serve

TRANSITIONS, EPOCHS, BEHAVIOURS = 640, 3, 5
# Rows of a round of inference: a tenth of a second, as on the other side.
ROWS_OF_A_ROUND = 4000


class Trunk(nn.Module):
    def __init__(self, n_heads):
        super().__init__()
        self.conv1 = nn.Conv1d(3, 32, 5, 2, 1)
        self.conv2 = nn.Conv1d(32, 32, 3, 2, 1)
        self.fc1 = nn.Linear(4096, 256)
        self.embedding = nn.Embedding(BEHAVIOURS, 32)
        self.fc2 = nn.Linear(292, 128)
        self.heads = nn.ModuleList([nn.Linear(128, 1) for _ in range(n_heads)])

    def forward(self, rows, tokens):
        laser = rows[:, :1536].reshape(-1, 3, 512)
        feature = torch.relu(self.conv2(torch.relu(self.conv1(laser)))).flatten(1)
        feature = torch.relu(self.fc1(feature))
        joined = torch.cat([feature, rows[:, 1536:], self.embedding(tokens)], 1)
        hidden = torch.relu(self.fc2(joined))
        outputs = [head(hidden) for head in self.heads]
        if len(outputs) == 2:
            return torch.cat([torch.sigmoid(outputs[0]), torch.tanh(outputs[1])], 1)
        return outputs[0]


def discriminator(n_inputs):
    return nn.Sequential(
        nn.Linear(n_inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, BEHAVIOURS)
    )


def main():
    work, threads = sys.argv[1], int(sys.argv[2])
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    states, state_actions = torch.rand(TRANSITIONS, 1540) - 0.5, torch.rand(TRANSITIONS, 1542) - 0.5
    tokens = torch.arange(TRANSITIONS) % BEHAVIOURS
    actor, critic = Trunk(2), Trunk(1)

    if work == "update":
        on_state_action, on_state = discriminator(1542), discriminator(1540)
        passes = [
            (actor, lambda: actor(states, tokens)),
            (critic, lambda: critic(states, tokens)),
            (on_state_action, lambda: on_state_action(state_actions)),
            (on_state, lambda: on_state(states)),
        ]
        optimisers = [torch.optim.Adam(network.parameters(), lr=5e-5) for network, _ in passes]

        def update():
            for (_, forward), optimiser in zip(passes, optimisers):
                for _ in range(EPOCHS):
                    optimiser.zero_grad()
                    (forward() ** 2).mean().backward()
                    optimiser.step()
            return 1

        update()
        serve("PyTorch", torch.__version__, threads, update)
    else:
        batch = int(work.removeprefix("forward-"))
        rows, few_tokens = states[:batch], tokens[:batch]
        calls = 1 + ROWS_OF_A_ROUND // batch

        def infer():
            with torch.inference_mode():
                for _ in range(calls):
                    actor(rows, few_tokens)
            return calls

        infer()
        serve("PyTorch", torch.__version__, threads, infer)


main()
