"""A room with round obstacles and a differential-drive robot with a laser: the world of the closed-loop tests."""

from __future__ import annotations

import math

import numpy as np

BEAMS = 512
RANGE_MAX = 10.0
HALF_ROOM = 5.0
START = (-4.0, -3.0, 0.6)
GOAL = (3.8, 3.2)
STANDING = [(-1.8, -1.2, 0.3), (0.3, 0.2, 0.35), (1.6, -1.8, 0.3)]
# Walks from one end to the other and back: ends, radius, speed.
WALKER = ((-1.0, 2.5), (2.5, 0.2), 0.25, 0.5)
# A base stops by itself when no command has come for this long (s), as real ones do.
BASE_TIMEOUT = 0.5


class Room:
    """The robot's true state, its sensors, and what it is told."""

    def __init__(self, start: tuple[float, float, float] = START) -> None:
        self.x, self.y, self.heading = start
        self.v = self.w = 0.0
        self.time = 0.0
        self.angles = np.arange(BEAMS) * (2.0 * math.pi / BEAMS) - math.pi

    def discs(self) -> list[tuple[float, float, float]]:
        (ax, ay), (bx, by), radius, speed = WALKER
        length = math.hypot(bx - ax, by - ay)
        along = (self.time * speed) % (2.0 * length)
        share = min(along, 2.0 * length - along) / length
        return [*STANDING, (ax + share * (bx - ax), ay + share * (by - ay), radius)]

    def step(self, v: float, w: float, dt: float) -> None:
        self.v, self.w = v, w
        self.x += v * math.cos(self.heading) * dt
        self.y += v * math.sin(self.heading) * dt
        self.heading = math.remainder(self.heading + w * dt, 2.0 * math.pi)
        self.time += dt

    def scan(self) -> np.ndarray:
        """Ranges of beams from −π on, counter-clockwise; infinite beyond the laser's range (REP 117)."""
        towards = self.angles + self.heading
        ux, uy = np.cos(towards), np.sin(towards)
        with np.errstate(divide="ignore"):
            to_x = (np.sign(ux) * HALF_ROOM - self.x) / ux
            to_y = (np.sign(uy) * HALF_ROOM - self.y) / uy
        ranges = np.minimum(np.where(ux == 0.0, np.inf, to_x), np.where(uy == 0.0, np.inf, to_y))
        for cx, cy, radius in self.discs():
            dx, dy = cx - self.x, cy - self.y
            along = ux * dx + uy * dy
            inside = along**2 - (dx * dx + dy * dy - radius * radius)
            hit = along - np.sqrt(np.maximum(inside, 0.0))
            ranges = np.where((inside >= 0.0) & (hit > 0.0), np.minimum(ranges, hit), ranges)
        ranges = np.where(ranges > RANGE_MAX, np.inf, ranges)
        return ranges.astype(np.float32)

    def clearance(self) -> float:
        """Distance from the robot's centre to the nearest surface."""
        walls = HALF_ROOM - max(abs(self.x), abs(self.y))
        return min([walls] + [math.hypot(cx - self.x, cy - self.y) - r for cx, cy, r in self.discs()])

    def goal_distance(self) -> float:
        return math.hypot(GOAL[0] - self.x, GOAL[1] - self.y)
