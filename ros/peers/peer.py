"""A peer of jostle-ros: a robot that drives in a room, or an observer of its commands.

Writes one JSON object a line, each at once, so that nothing is lost when the process is killed. Times are nanoseconds since
1970, by the one clock of this machine.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import threading
import time
from pathlib import Path

from room import BASE_TIMEOUT, GOAL, Room

STEP = 0.02
STEPS_A_SCAN = 5
STEPS_A_GOAL = 25


class Log:
    def __init__(self, path: Path) -> None:
        self.file, self.lock = path.open("a", buffering=1), threading.Lock()

    def write(self, **fields) -> None:
        with self.lock:
            self.file.write(json.dumps(fields) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=["robot", "observer"])
    parser.add_argument("--over", choices=["rclpy", "cyclonedds"], required=True)
    parser.add_argument("--log", type=Path, required=True)
    parser.add_argument("--stamped", action="store_true", help="commands are TwistStamped")
    parser.add_argument("--seconds", type=float, default=60.0, help="longest time")
    parser.add_argument("--start", type=float, nargs=3, help="x, y, heading")
    arguments = parser.parse_args()
    log = Log(arguments.log)
    latest = {"at": 0, "v": 0.0, "w": 0.0}

    def heard(v: float, w: float, stamp: int) -> None:
        now = time.time_ns()
        latest.update(at=now, v=v, w=w)
        log.write(event="command", t=now, t_ns=now, v=v, w=w, stamp=stamp)

    link = importlib.import_module(f"over_{arguments.over}").Link(arguments.role, arguments.stamped, heard)
    log.write(event="ready", t=time.time_ns())
    if arguments.role == "robot":
        link.advertise()
        drive(link, log, latest, arguments)
    else:
        time.sleep(arguments.seconds)
    # The log is written; the middlewares' own ends, with threads that still read, are not what is tested here.
    os._exit(0)


def drive(link, log: Log, latest: dict, arguments) -> None:
    room = Room(tuple(arguments.start)) if arguments.start else Room()
    beat = time.monotonic()
    arrived = None
    for step in range(int(arguments.seconds / STEP)):
        now = time.time_ns()
        alive = now - latest["at"] < BASE_TIMEOUT * 1e9
        room.step(latest["v"] if alive else 0.0, latest["w"] if alive else 0.0, STEP)
        link.send_odometry(now, room.x, room.y, room.heading, room.v, room.w)
        if step % STEPS_A_SCAN == 0:
            ranges = room.scan()
            stamp = time.time_ns()
            link.send_scan(stamp, ranges)
            pose = {"x": room.x, "y": room.y, "heading": room.heading, "v": room.v}
            log.write(event="scan", t=stamp, t_ns=stamp, clearance=room.clearance(), discs=room.discs(), **pose)
        if step % STEPS_A_GOAL == 0:
            link.send_goal(now, *GOAL)
        if arrived is None and room.goal_distance() < 0.5:
            arrived = step
            log.write(event="arrived", t=now, x=room.x, y=room.y)
        if arrived is not None and step > arrived + 50:
            log.write(event="rests", t=now, x=room.x, y=room.y, v=room.v, w=room.w)
            return
        beat += STEP
        time.sleep(max(0.0, beat - time.monotonic()))


if __name__ == "__main__":
    main()
