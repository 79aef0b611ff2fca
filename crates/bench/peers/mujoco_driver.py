"""Table 5's episodes in MuJoCo: a peer in three dimensions that shares neither laser, nor wheels, nor contacts with jostle.

Of jostle come, through its Python package, the episodes (start, goal, pedestrians), the pedestrians' steps (social force), the noise on the
ranges with the observation's layout, and the robot's decisions. Of MuJoCo come the robot's motion, its rays, its contacts, and with
them goal and crash. A line of JSON says what runs; then there is one for each episode::

    python mujoco_driver.py --config room.toml --pedestrians 5 --episodes 100 --policy checkpoints/m5-seed1-005000.safetensors
    python mujoco_driver.py --config room.toml --pedestrians 5 --episodes 100 --planner dwa

The world: walls of 2 m, the map's obstacles as prisms of 1.5 m, pedestrians as prisms of 1.7 m on the test's own footprint, moved along
their steps in every substep (mocap bodies); a floor.

The robot: a Jackal of the URDF's masses, inertias, centre of mass and wheels (`jackal_description/urdf/jackal.urdf.xacro`,
jackal/jackal), and the test's footprint as its chassis. Four wheels with Coulomb friction, each with a servo that holds its speed within
a torque; the wheels' commands are those of `control.yaml` (the track times 1.5), which hold from 0.02 s after the decision on.
20 substeps of 5 ms make a control period.

The laser: rays of `mj_multiRay` in the robot's own plane, from the middle of the robot, 0.25 m above its base. They tilt as it does.

The end of an episode, by the test's rules: the goal is nearer than its radius; else the least ray is shorter than the crash range, and
what it met says whether that was a pedestrian or something solid; else MuJoCo found a contact of the robot with something else
than the floor; else the time is up.

Departures from a real Jackal and from the test:

- Each wheel has a motor of its own; the vehicle has one for each side (so does Gazebo's model).
- The motors hold their full torque at any speed; friction, a tenth of it, is what limits the wheels.
- A wheel turns with the inertia of `ROTOR` besides its own, as that of a motor's rotor behind a gear. No figure of it is published.
  Rigid wheels that slide over a rigid floor hop, and a bare wheel is without its servo's torque for some substeps after each hop: what
  the robot does then depends on the substep, and at 5 ms it turns on the spot at a quarter of the rate it should. With a rotor, turns, starts and
  stops are the closed forms within 5 %, whatever the substep. `docs/how-to-dynamics.md` has the figures.
- The footprint is the test's, 508 mm by 430 mm; the URDF's collision box is smaller.
- Pedestrians push and are not pushed. They step where the robot stood when the period began.
- Limits of acceleration are left out: those of `control.yaml` do not bind at 1 m/s.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

import jostle

Array = NDArray[np.float64]

#: To be raised whenever an episode may end differently; `crates/study/src/reproduce/mujoco.rs` expects the same.
MODEL = 1

# jackal_description/urdf/jackal.urdf.xacro.
CHASSIS_MASS = 16.523
CENTRE_OF_MASS = (0.012, 0.002, 0.067)
CHASSIS_INERTIA = (0.3136, 0.3922, 0.4485, -0.0008, 0.0164, -0.0009)  # xx, yy, zz, xy, xz, yz
CHASSIS_HEIGHT = 0.184
WHEEL_MASS = 0.477
WHEEL_INERTIA = (0.0013, 0.0024, 0.0013)
WHEEL_RADIUS, WHEEL_WIDTH = 0.098, 0.040
WHEELBASE, TRACK = 0.262, 0.37559
AXLE = 0.0345  # height above the base
FRICTION = 0.5  # mu1, mu2
# jackal_control/config/control.yaml.
TURN_GAIN = 1.5  # wheel_separation_multiplier
LATENCY = 0.02  # a period at 50 Hz
# Data sheet: 500 W at 2 m/s.
MOTOR_TORQUE = 24.5

#: Inertia of a motor behind its gear, as its wheel feels it (kg m²), and gain of the servo (N m s). See above.
ROTOR, SERVO = 0.1, 20.0
#: Substep (s).
SUBSTEP = 0.005
#: Heights of laser (above the base), walls, obstacles, pedestrians (m).
LASER, WALLS, SHELVES, PEOPLE = 0.25, 2.0, 1.5, 1.7
#: Half the thickness of a wall and of a segment (m); walls stand outside of the room.
HALF_WALL, HALF_SEGMENT = 0.25, 0.005

# Groups of geoms. Rays see all but the robot's own.
FLOOR, SOLID, PERSON, ROBOT = 0, 1, 2, 3
SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)


class World:
    """A map with a robot and pedestrians in MuJoCo."""

    def __init__(
        self,
        walls: Array,
        obstacles: list[jostle.Obstacle],
        body: tuple[float, float],
        n_pedestrians: int,
        beam_angles: Array,
    ) -> None:
        self.model = mujoco.MjModel.from_xml_string(_xml(walls, obstacles, body, n_pedestrians))
        self.data = mujoco.MjData(self.model)
        self.groups = self.model.geom_group
        self.site = self.model.site("laser").id
        rays = np.stack([np.cos(beam_angles), np.sin(beam_angles), np.zeros_like(beam_angles)], axis=1)
        self.rays: Array = rays
        self.hits = np.zeros(len(rays), np.int32)
        self.distances = np.zeros(len(rays))
        self.directions = np.zeros_like(rays)
        # Where the springs of the contacts hold the robot at rest.
        mujoco.mj_step(self.model, self.data, nstep=200)
        self.height = float(self.data.qpos[2])

    def place(self, pose: Array, pedestrians: Array) -> None:
        """Puts everybody somewhere, at rest."""
        mujoco.mj_resetData(self.model, self.data)
        x, y, heading = pose
        self.data.qpos[:7] = [x, y, self.height, np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
        self._put(pedestrians[:, :2], pedestrians[:, 2])
        mujoco.mj_forward(self.model, self.data)

    def drive(self, before: tuple[float, float], command: tuple[float, float], dt: float, start: Array, end: Array) -> None:
        """A control period: the command takes over from the one before; pedestrians go from `start` to `end`."""
        substeps, late = round(dt / SUBSTEP), round(LATENCY / SUBSTEP)
        share = np.arange(1, substeps + 1)[:, None] / substeps
        places = start[:, :2] + share[..., None] * (end[:, :2] - start[:, :2])
        turned = np.remainder(end[:, 2] - start[:, 2] + np.pi, 2 * np.pi) - np.pi
        headings = start[:, 2] + share * turned
        for i in range(substeps):
            if i in (0, late):
                self.data.ctrl[:] = wheel_speeds(*(before if i < late else command))
            self._put(places[i], headings[i])
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)

    def pose(self) -> Array:
        """x, y, heading of the robot."""
        x, y, _, a, b, c, d = self.data.qpos[:7]
        return np.array([x, y, np.arctan2(2 * (a * d + b * c), 1 - 2 * (c * c + d * d))])

    def velocity(self) -> tuple[float, float]:
        """What odometry measures: speed along the heading and turn rate."""
        heading = self.pose()[2]
        vx, vy = self.data.qvel[:2]
        turn = self.data.site_xmat[self.site].reshape(3, 3) @ self.data.qvel[3:6]
        return float(vx * np.cos(heading) + vy * np.sin(heading)), float(turn[2])

    def scan(self, reach: float) -> Array:
        """The ranges, at most `reach`; what each met is in `hits` (−1: nothing)."""
        np.matmul(self.rays, self.data.site_xmat[self.site].reshape(3, 3).T, out=self.directions)
        mujoco.mj_multiRay(
            self.model,
            self.data,
            self.data.site_xpos[self.site],
            self.directions.ravel(),
            SEEN,
            1,
            -1,
            self.hits,
            self.distances,
            None,
            len(self.rays),
            reach,
        )
        return np.where((self.distances < 0) | (self.distances > reach), reach, self.distances)

    def crash(self, ranges: Array, crash_range: float) -> str | None:
        """What the robot has run into, or was run into by."""
        nearest = int(np.argmin(ranges))
        if ranges[nearest] < crash_range:
            return self._outcome(self.hits[nearest])
        for contact in self.data.contact[: self.data.ncon]:
            one, other = (int(geom) for geom in contact.geom)
            groups = {self.groups[one], self.groups[other]}
            if ROBOT in groups and FLOOR not in groups:
                return self._outcome(other if self.groups[one] == ROBOT else one)
        return None

    def _outcome(self, geom: int) -> str:
        return "collision_pedestrian" if geom >= 0 and self.groups[geom] == PERSON else "collision_wall"

    def _put(self, places: Array, headings: Array) -> None:
        self.data.mocap_pos[:, :2] = places
        self.data.mocap_quat[:, 0] = np.cos(headings / 2)
        self.data.mocap_quat[:, 3] = np.sin(headings / 2)


def wheel_speeds(v: float, w: float) -> tuple[float, float, float, float]:
    """Speeds of the wheels front left, front right, rear left, rear right (rad/s)."""
    half = TURN_GAIN * TRACK / 2
    left, right = (v - w * half) / WHEEL_RADIUS, (v + w * half) / WHEEL_RADIUS
    return left, right, left, right


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _box(x: float, y: float, heading: float, half: tuple[float, float, float], group: int) -> str:
    return (
        f'<geom type="box" pos="{_numbers(x, y, half[2])}" size="{_numbers(*half)}" '
        f'euler="{_numbers(0, 0, heading)}" group="{group}"/>'
    )


def _xml(walls: Array, obstacles: list[jostle.Obstacle], body: tuple[float, float], n_pedestrians: int) -> str:
    (left, below), (right, above) = (tuple(map(float, corner)) for corner in walls)
    x, y = (left + right) / 2, (below + above) / 2
    wide, high = (right - left) / 2 + 2 * HALF_WALL, (above - below) / 2 + 2 * HALF_WALL
    solid = [
        _box(left - HALF_WALL, y, 0, (HALF_WALL, high, WALLS / 2), SOLID),
        _box(right + HALF_WALL, y, 0, (HALF_WALL, high, WALLS / 2), SOLID),
        _box(x, below - HALF_WALL, 0, (wide, HALF_WALL, WALLS / 2), SOLID),
        _box(x, above + HALF_WALL, 0, (wide, HALF_WALL, WALLS / 2), SOLID),
    ]
    meshes = []
    for i, (kind, numbers) in enumerate(obstacles):
        if kind == "box":
            ox, oy, heading, length, width = map(float, numbers)
            solid.append(_box(ox, oy, heading, (length / 2, width / 2, SHELVES / 2), SOLID))
        elif kind == "circle":
            ox, oy, radius = map(float, numbers)
            place, size = _numbers(ox, oy, SHELVES / 2), _numbers(radius, SHELVES / 2)
            solid.append(f'<geom type="cylinder" pos="{place}" size="{size}" group="{SOLID}"/>')
        elif kind == "segment":
            a, b = np.asarray(numbers, float)
            ox, oy = (a + b) / 2
            length, heading = np.linalg.norm(b - a), np.arctan2(*(b - a)[::-1])
            solid.append(_box(ox, oy, heading, (length / 2, HALF_SEGMENT, SHELVES / 2), SOLID))
        else:
            corners = [_numbers(*map(float, corner), z) for corner in numbers for z in (0, SHELVES)]
            # MuJoCo moves a mesh to its centre of mass and its geom back again.
            meshes.append(f'<mesh name="prism{i}" vertex="{" ".join(corners)}"/>')
            solid.append(f'<geom type="mesh" mesh="prism{i}" group="{SOLID}"/>')
    length, width = body
    people = "".join(
        f'<body mocap="true" pos="{1000 + i} 1000 0">{_box(0, 0, 0, (length / 2, width / 2, PEOPLE / 2), PERSON)}</body>'
        for i in range(n_pedestrians)
    )
    wheels = "".join(
        f'<body pos="{_numbers(x, y, AXLE)}"><joint name="{name}" type="hinge" axis="0 1 0" armature="{ROTOR}"/>'
        f'<inertial pos="0 0 0" mass="{WHEEL_MASS}" diaginertia="{_numbers(*WHEEL_INERTIA)}"/>'
        f'<geom type="cylinder" size="{_numbers(WHEEL_RADIUS, WHEEL_WIDTH / 2)}" euler="{_numbers(np.pi / 2, 0, 0)}" '
        f'group="{ROBOT}"/></body>'
        for name, x, y in (
            ("front_left", WHEELBASE / 2, TRACK / 2),
            ("front_right", WHEELBASE / 2, -TRACK / 2),
            ("rear_left", -WHEELBASE / 2, TRACK / 2),
            ("rear_right", -WHEELBASE / 2, -TRACK / 2),
        )
    )
    servos = "".join(
        f'<velocity joint="{name}" kv="{SERVO}" forcerange="{_numbers(-MOTOR_TORQUE, MOTOR_TORQUE)}"/>'
        for name in ("front_left", "front_right", "rear_left", "rear_right")
    )
    return f"""<mujoco>
  <compiler angle="radian"/>
  <option timestep="{SUBSTEP}" cone="elliptic" integrator="implicitfast"/>
  <default><geom friction="{FRICTION} 0 0" condim="3"/></default>
  <asset>{"".join(meshes)}</asset>
  <worldbody>
    <geom type="plane" size="100 100 1" group="{FLOOR}"/>
    {"".join(solid)}
    {people}
    <body pos="{_numbers(x, y, WHEEL_RADIUS - AXLE)}">
      <freejoint/>
      <inertial pos="{_numbers(*CENTRE_OF_MASS)}" mass="{CHASSIS_MASS}" fullinertia="{_numbers(*CHASSIS_INERTIA)}"/>
      <geom type="box" pos="{_numbers(0, 0, CHASSIS_HEIGHT / 2)}" size="{_numbers(length / 2, width / 2, CHASSIS_HEIGHT / 2)}"
        group="{ROBOT}"/>
      <site name="laser" pos="{_numbers(0, 0, LASER)}"/>
      {wheels}
    </body>
  </worldbody>
  <actuator>{servos}</actuator>
</mujoco>"""


def world_of(room: jostle.PeerRoom, n_pedestrians: int) -> World:
    """The world of a room of jostle's."""
    return World(room.walls.astype(float), room.obstacles, room.body, n_pedestrians, room.beam_angles)


def episode(
    room: jostle.PeerRoom, world: World, drive: Callable[[NDArray[np.float32]], NDArray[np.float32]], index: int
) -> dict[str, Any]:
    """One episode: its outcome, steps and way."""
    start = room.begin(index)
    pose, goal = start["pose"].astype(float), start["goal"].astype(float)
    world.place(pose, start["pedestrians"].astype(float))
    way, command = 0.0, (0.0, 0.0)
    row = room.observe(pose, (0.0, 0.0), world.scan(room.laser_range))
    v_max, w_max = room.limits
    for step in range(1, room.step_limit + 1):
        v, w = (float(value) for value in drive(row))
        before, command = command, (min(max(v, 0.0), v_max), min(max(w, -w_max), w_max))
        people = room.pedestrians().astype(float)
        world.drive(before, command, room.dt, people, room.walk().astype(float))
        place = world.pose()
        way += float(np.hypot(*(place[:2] - pose[:2])))
        pose = place
        ranges = world.scan(room.laser_range)
        if np.hypot(*(goal - pose[:2])) < room.goal_radius:
            outcome = "success"
        else:
            outcome = world.crash(ranges, room.crash_range) or ("timeout" if step == room.step_limit else "")
        if outcome:
            straight = start["goal"].astype(float) - start["pose"][:2].astype(float)
            return {
                "episode": index,
                "outcome": outcome,
                "steps": step,
                "path_length": way,
                "straight_distance": float(np.hypot(*straight)),
            }
        row = room.observe(pose, world.velocity(), ranges)
    raise AssertionError("an episode ends at its last step")


def run(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """What runs, then every episode."""
    room = jostle.PeerRoom(
        "SF",
        config=arguments.config,
        n_pedestrians=arguments.pedestrians,
        respawn_clearance=arguments.respawn_clearance,
    )
    drive: jostle.Policy | jostle.Planner
    if arguments.policy:
        drive = jostle.Policy(arguments.policy)
        sha256 = drive.core.sha256
    else:
        drive = jostle.planner(arguments.planner, config=arguments.config)
        sha256 = drive.core.sha256
    yield {
        "simulator": "mujoco",
        "version": mujoco.__version__,
        "model": MODEL,
        "driver": hashlib.sha256(Path(__file__).read_bytes()).hexdigest(),
        "numpy": np.__version__,
        "python": platform.python_version(),
        "settings": room.settings_hash,
        "policy": sha256,
    }
    world = world_of(room, arguments.pedestrians)
    for index in range(arguments.episodes):
        yield episode(room, world, drive, index)


def main() -> None:
    """Prints a line of JSON for what runs and one for each episode."""
    parser = argparse.ArgumentParser(description="Episodes of jostle's test in MuJoCo.")
    parser.add_argument("--config", required=True, help="TOML as `cargo xtask train` reads it: room, robot, laser")
    parser.add_argument("--pedestrians", type=int, required=True)
    parser.add_argument("--episodes", type=int, required=True)
    parser.add_argument("--respawn-clearance", type=float, default=None)
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument("--policy", help="a checkpoint; its behaviour token is 0")
    robot.add_argument("--planner", help="a planner's name")
    for line in run(parser.parse_args()):
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
