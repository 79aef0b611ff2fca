"""The robot's topics by rclpy, ROS 2's own Python client."""

from __future__ import annotations

import array
import math
import threading
from typing import Callable

import rclpy
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from room import BEAMS, RANGE_MAX

# v, ω, stamp in nanoseconds (0 where the message has none).
OnCommand = Callable[[float, float, int], None]


class Link:
    def __init__(self, name: str, stamped: bool, on_command: OnCommand) -> None:
        rclpy.init()
        self.node = rclpy.create_node(name)
        reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        if stamped:

            def heard(message: TwistStamped) -> None:
                stamp = message.header.stamp
                twist = message.twist
                on_command(twist.linear.x, twist.angular.z, stamp.sec * 10**9 + stamp.nanosec)
        else:

            def heard(message: Twist) -> None:
                on_command(message.linear.x, message.angular.z, 0)

        self.node.create_subscription(TwistStamped if stamped else Twist, "/cmd_vel", heard, reliable)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        try:
            self.executor.spin()
        except ExternalShutdownException:
            pass

    def advertise(self) -> None:
        self.scans = self.node.create_publisher(LaserScan, "/scan", qos_profile_sensor_data)
        self.odometry = self.node.create_publisher(Odometry, "/odom", 10)
        self.goals = self.node.create_publisher(PoseStamped, "/goal", 10)

    def send_scan(self, stamp: int, ranges) -> None:
        message = LaserScan()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id = "laser"
        message.angle_min, message.angle_increment = -math.pi, 2.0 * math.pi / BEAMS
        message.angle_max = message.angle_min + (BEAMS - 1) * message.angle_increment
        message.scan_time = 0.1
        message.range_min, message.range_max = 0.05, RANGE_MAX
        message.ranges = array.array("f", ranges.tobytes())
        self.scans.publish(message)

    def send_odometry(self, stamp: int, x: float, y: float, heading: float, v: float, w: float) -> None:
        message = Odometry()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        orientation = message.pose.pose.orientation
        orientation.z, orientation.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
        message.twist.twist.linear.x, message.twist.twist.angular.z = v, w
        self.odometry.publish(message)

    def send_goal(self, stamp: int, x: float, y: float) -> None:
        message = PoseStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id = "odom"
        message.pose.position.x, message.pose.position.y = x, y
        message.pose.orientation.w = 1.0
        self.goals.publish(message)
