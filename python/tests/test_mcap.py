"""MCAP files that `jostle-mcap` writes, read by two readers that share nothing with it or with each other."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

MOMENTS = 30


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of the crate's example: a robot drives along x, a pedestrian comes down."""
    file = tmp_path_factory.mktemp("mcap") / "small.mcap"
    cargo = ["cargo", "run", "--quiet", "--release", "--package", "jostle-mcap", "--example", "small", "--", file]
    subprocess.run(cargo, cwd=ROOT, check=True)
    return file


def check(topic: str, step: int, message) -> None:
    time = step * 0.1
    if topic == "/scan":
        assert message.header.frame_id == "laser"
        assert message.header.stamp.sec == 1 + step // 10 and len(message.ranges) == 8
        assert message.ranges[2] == 5.0 and math.isinf(message.ranges[4])
        assert math.isclose(message.angle_increment, math.tau / 8, rel_tol=1e-6)
    elif topic == "/odom":
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        assert math.isclose(message.pose.pose.position.x, time - 5.0, abs_tol=1e-6)
        assert message.twist.twist.linear.x == 1.0 and len(message.pose.covariance) == 36
    elif topic == "/tf":
        chain = [(transform.header.frame_id, transform.child_frame_id) for transform in message.transforms]
        assert chain == [("map", "base_link"), ("base_link", "laser")]
    else:
        names = [marker.ns for marker in message.markers]
        assert names == (["", "walls"] if step == 0 else []) + ["goal", "pedestrians"]
        assert math.isclose(message.markers[-1].pose.position.y, 2.0 - time, abs_tol=1e-6)
        assert step > 0 or len(message.markers[1].points) == 4


def test_mcap_ros2_support_reads_all_of_it(recording: Path) -> None:
    counts: dict[str, int] = {}
    for found in read_ros2_messages(recording):
        topic = found.channel.topic
        check(topic, counts.get(topic, 0), found.ros_msg)
        counts[topic] = counts.get(topic, 0) + 1
    assert counts == dict.fromkeys(["/tf", "/odom", "/scan", "/markers"], MOMENTS)


def test_rosbags_reads_all_of_it(recording: Path) -> None:
    counts: dict[str, int] = {}
    with AnyReader([recording]) as reader:
        for connection, _, raw in reader.messages():
            topic = connection.topic
            check(topic, counts.get(topic, 0), reader.deserialize(raw, connection.msgtype))
            counts[topic] = counts.get(topic, 0) + 1
    assert counts == dict.fromkeys(["/tf", "/odom", "/scan", "/markers"], MOMENTS)
