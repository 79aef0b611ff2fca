"""Work U, the actor's inference and large updates in PyTorch, eager, on the CPU:
`torch_driver.py update|forward-B|learner-paper|learner-pooled|learner-motion THREADS`.

Work U: 640 transitions in one full batch; three epochs each of actor, critic and both discriminators: forward, backward
and Adam; the loss is the mean of the squared outputs. The networks are the paper's: two convolutions over three scans of
512 beams, 256 units, the goal, the velocity and the behaviour's embedding joined, 128 units.

A large update: actions for each step's rows, values of all rows, and epochs of shuffled minibatches for actor and critic, with the
same loss. Sizes as in `crates/bench/src/large_updates.rs`.
"""

import sys

import torch
from torch import nn

from rounds import serve

TRANSITIONS, EPOCHS, BEHAVIOURS = 640, 3, 5
# Rows of a round of inference: a tenth of a second, as on the other side.
ROWS_OF_A_ROUND = 4000


def outputs_of(heads, hidden):
    outputs = [head(hidden) for head in heads]
    if len(outputs) == 2:
        return torch.cat([torch.sigmoid(outputs[0]), torch.tanh(outputs[1])], 1)
    return outputs[0]


class Trunk(nn.Module):
    def __init__(self, n_heads, beams=512, behaviours=BEHAVIOURS):
        super().__init__()
        self.beams = beams
        self.conv1 = nn.Conv1d(3, 32, 5, 2, 1)
        self.conv2 = nn.Conv1d(32, 32, 3, 2, 1)
        self.fc1 = nn.Linear(32 * (beams // 4), 256)
        self.embedding = nn.Embedding(behaviours, 32)
        self.fc2 = nn.Linear(292, 128)
        self.heads = nn.ModuleList([nn.Linear(128, 1) for _ in range(n_heads)])

    def forward(self, rows, tokens):
        laser = rows[:, : 3 * self.beams].reshape(-1, 3, self.beams)
        feature = torch.relu(self.conv2(torch.relu(self.conv1(laser)))).flatten(1)
        feature = torch.relu(self.fc1(feature))
        joined = torch.cat([feature, rows[:, 3 * self.beams :], self.embedding(tokens)], 1)
        hidden = torch.relu(self.fc2(joined))
        return outputs_of(self.heads, hidden)


class Perceptron(nn.Module):
    """Bodies with their velocities, and the token as one of M ones behind them."""

    def __init__(self, n_heads, inputs):
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(inputs + 1, 256), nn.Linear(256, 128)
        self.heads = nn.ModuleList([nn.Linear(128, 1) for _ in range(n_heads)])

    def forward(self, rows, tokens):
        joined = torch.cat([rows, nn.functional.one_hot(tokens, 1).float()], 1)
        return outputs_of(self.heads, torch.relu(self.fc2(torch.relu(self.fc1(joined)))))


def discriminator(n_inputs):
    return nn.Sequential(
        nn.Linear(n_inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, BEHAVIOURS)
    )


# Values of an input row of bodies with their velocities.
MOTION_INPUTS = 215

# Agents, steps, minibatch, epochs, width of a row, and how a network of so many heads is made.
LARGE = {
    "paper": (80, 100, 1000, 3, 1540, lambda heads: Trunk(heads, 512, 1)),
    "pooled": (160, 64, 512, 1, 388, lambda heads: Trunk(heads, 128, 1)),
    "motion": (384, 64, 1024, 2, MOTION_INPUTS, lambda heads: Perceptron(heads, MOTION_INPUTS)),
}


def large_update(shape, threads):
    agents, steps, minibatch, epochs, width, make = LARGE[shape]
    transitions = agents * steps
    rows, tokens = torch.rand(transitions, width) - 0.5, torch.zeros(transitions, dtype=torch.long)
    actor, critic = make(2), make(1)
    halves = [(network, torch.optim.Adam(network.parameters(), lr=5e-4)) for network in (actor, critic)]

    def update():
        with torch.inference_mode():
            for step in range(steps):
                actor(rows[step * agents : (step + 1) * agents], tokens[:agents])
            for first in range(0, transitions, minibatch):
                critic(rows[first : first + minibatch], tokens[first : first + minibatch])
        for network, optimiser in halves:
            for _ in range(epochs):
                for chosen in torch.randperm(transitions).split(minibatch):
                    optimiser.zero_grad()
                    (network(rows[chosen], tokens[chosen]) ** 2).mean().backward()
                    optimiser.step()
        return transitions

    update()
    serve("PyTorch", torch.__version__, threads, update)


def main():
    work, threads = sys.argv[1], int(sys.argv[2])
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    if work.startswith("learner-"):
        large_update(work.removeprefix("learner-"), threads)
        return
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
