"""Rooms of five robots with noisy lasers of 512 beams in VMAS: `vmas_driver.py simulator-R THREADS`."""

import math
import sys
from importlib.metadata import version

import torch

from rounds import serve

ROBOTS, BEAMS, RANGE, SIDE = 5, 512, 10.0, 20.0


def scenario():
    from vmas.simulator.core import Agent, Box, Landmark, Line, World
    from vmas.simulator.dynamics.diff_drive import DiffDrive
    from vmas.simulator.scenario import BaseScenario
    from vmas.simulator.sensors import Lidar

    class Room(BaseScenario):
        def make_world(self, batch_dim, device, **kwargs):
            world = World(batch_dim, device, dt=0.1, substeps=1, x_semidim=SIDE / 2, y_semidim=SIDE / 2)
            for i in range(ROBOTS):
                laser = Lidar(world, angle_start=0.0, angle_end=2 * math.pi, n_rays=BEAMS, max_range=RANGE)
                agent = Agent(
                    name=f"robot_{i}",
                    shape=Box(length=0.5, width=0.5),
                    dynamics=DiffDrive(world, integration="euler"),
                    u_range=[1.0, 1.0],
                    sensors=[laser],
                    render_action=False,
                )
                world.add_agent(agent)
            for i in range(4):
                wall = Landmark(name=f"wall_{i}", collide=True, movable=False, shape=Line(length=SIDE))
                world.add_landmark(wall)
            return world

        def reset_world_at(self, env_index=None):
            def place(entity, x, y, rotation):
                entity.set_pos(torch.tensor([x, y], device=self.world.device), batch_index=env_index)
                entity.set_rot(torch.tensor([rotation], device=self.world.device), batch_index=env_index)

            for i, agent in enumerate(self.world.agents):
                angle = 2 * math.pi * i / ROBOTS
                place(agent, 6.0 * math.cos(angle), 6.0 * math.sin(angle), angle)
            for i, wall in enumerate(self.world.landmarks):
                angle = math.pi / 2 * i
                place(wall, SIDE / 2 * math.cos(angle), SIDE / 2 * math.sin(angle), angle + math.pi / 2)

        def reward(self, agent):
            return torch.zeros(self.world.batch_dim, device=self.world.device)

        def observation(self, agent):
            ranges = agent.sensors[0].measure()
            noisy = ranges + 0.02 * torch.randn_like(ranges)
            return torch.cat([noisy / RANGE - 0.5, agent.state.pos, agent.state.vel], dim=-1)

    return Room()


def main():
    work, threads = sys.argv[1], int(sys.argv[2])
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    protocol, sys.stdout = sys.stdout, sys.stderr
    import vmas

    rooms = int(work.removeprefix("simulator-"))
    env = vmas.make_env(scenario(), num_envs=rooms, device="cpu", continuous_actions=True, seed=0)
    step = 0

    def one_step():
        nonlocal step
        turn = math.sin(step * 0.05)
        actions = [
            torch.tensor([[0.7, max(-1.0, min(1.0, turn * (i % 3)))]]).expand(rooms, 2) for i in range(ROBOTS)
        ]
        with torch.no_grad():
            env.step(actions)
        step += 1
        return rooms * ROBOTS

    one_step()
    sys.stdout = protocol
    serve("VMAS", version("vmas"), threads, one_step)


main()
