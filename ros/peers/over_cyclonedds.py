"""The robot's topics by Eclipse Cyclone DDS, an implementation of DDS that shares nothing with the others; no ROS at all."""

import math
import os
import threading
from dataclasses import dataclass
from typing import Callable

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from room import BEAMS, RANGE_MAX

OnCommand = Callable[[float, float, int], None]

# ROS 2's names on the wire: types in `dds_` and with an underscore, topics behind `rt`.


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


def _qos(reliable: bool) -> Qos:
    reliability = Policy.Reliability.Reliable(duration(milliseconds=100)) if reliable else Policy.Reliability.BestEffort
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(10))


def _header(stamp: int, frame: str) -> Header:
    sec, nanosec = divmod(stamp, 10**9)
    return Header(Time(sec, nanosec), frame)


class Link:
    def __init__(self, name: str, stamped: bool, on_command: OnCommand) -> None:
        self.participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        kind = TwistStamped if stamped else Twist
        topic = Topic(self.participant, "rt/cmd_vel", kind, qos=_qos(True))
        self.reader = DataReader(self.participant, topic, qos=_qos(True))
        self.stamped, self.on_command = stamped, on_command
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        while True:
            for message in self.reader.take_iter(timeout=duration(milliseconds=200)):
                if isinstance(message, InvalidSample):
                    continue
                stamp = message.header.stamp if self.stamped else Time()
                twist = message.twist if self.stamped else message
                self.on_command(twist.linear.x, twist.angular.z, stamp.sec * 10**9 + stamp.nanosec)

    def advertise(self) -> None:
        def writer(name: str, kind: type, reliable: bool) -> DataWriter:
            return DataWriter(self.participant, Topic(self.participant, name, kind, qos=_qos(reliable)), qos=_qos(reliable))

        self.scans = writer("rt/scan", LaserScan, False)
        self.odometry = writer("rt/odom", Odometry, True)
        self.goals = writer("rt/goal", PoseStamped, True)

    def send_scan(self, stamp: int, ranges) -> None:
        increment = 2.0 * math.pi / BEAMS
        angle_max = -math.pi + (BEAMS - 1) * increment
        header = _header(stamp, "laser")
        values = ranges.tolist()
        self.scans.write(LaserScan(header, -math.pi, angle_max, increment, 0.0, 0.1, 0.05, RANGE_MAX, values, []))

    def send_odometry(self, stamp: int, x: float, y: float, heading: float, v: float, w: float) -> None:
        pose = Pose(Point(x, y), Quaternion(0.0, 0.0, math.sin(heading / 2.0), math.cos(heading / 2.0)))
        twist = Twist(Vector3(v), Vector3(0.0, 0.0, w))
        zeros = [0.0] * 36
        self.odometry.write(
            Odometry(_header(stamp, "odom"), "base_link", PoseWithCovariance(pose, zeros), TwistWithCovariance(twist, zeros))
        )

    def send_goal(self, stamp: int, x: float, y: float) -> None:
        self.goals.write(PoseStamped(_header(stamp, "odom"), Pose(Point(x, y), Quaternion())))
