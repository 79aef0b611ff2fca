"""One room of five robots with noisy lasers of 512 beams in IR-SIM: `irsim_driver.py simulator-1 THREADS`."""

import logging
import math
import os
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

from rounds import serve

ROBOTS = 5


def main():
    threads = int(sys.argv[2])
    logging.disable(logging.CRITICAL)
    world = Path(__file__).with_name("irsim_room.yaml")
    # IR-SIM reports on standard output, even while it is imported; the protocol needs that for itself.
    protocol, sys.stdout = sys.stdout, sys.stderr
    os.environ.setdefault("MPLBACKEND", "Agg")
    import irsim

    env = irsim.make(str(world), display=False, disable_all_plot=True, log_level="ERROR")
    step = 0

    def steps():
        nonlocal step
        for _ in range(10):
            turn = math.sin(step * 0.05)
            actions = [np.array([[0.7], [np.clip(turn * (i % 3), -1.0, 1.0)]]) for i in range(ROBOTS)]
            env.step(actions, list(range(ROBOTS)))
            for robot in env.robot_list:
                robot.get_lidar_scan()
            step += 1
        return 10 * ROBOTS

    steps()
    sys.stdout = protocol
    serve("IR-SIM", version("ir-sim"), threads, steps)


main()
