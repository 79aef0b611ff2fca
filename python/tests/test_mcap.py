"""MCAP files that `replay --mcap` writes, read by two readers that share nothing with it or with each other."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

EPISODES = 2
DRIVERS = ["dwa", "straight"]
TOPICS = ["/tf", "/odom", "/scan", "/markers"]


class Replay(NamedTuple):
    """What the command wrote: the recording, and the data of the page."""

    file: Path
    page: dict[str, Any]


@pytest.fixture(scope="module")
def replay(xtask: Callable[..., str], tmp_path_factory: pytest.TempPathFactory) -> Replay:
    folder = tmp_path_factory.mktemp("replay")
    file = folder / "episodes.mcap"
    which = ["--crowd", "SF", "--episodes", EPISODES]
    xtask("replay", DRIVERS[0], "--against", DRIVERS[1], *which, "--out", folder, "--mcap", file)
    html = (folder / "index.html").read_text(encoding="utf-8")
    found = re.search(r'<script[^>]*type="application/json"[^>]*>(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return Replay(file, json.loads(found.group(1)))


def integers(text: str, width: int) -> np.ndarray:
    """The page's little-endian 16-bit integers, a row a frame."""
    return np.frombuffer(base64.b64decode(text), dtype="<i2").reshape(-1, width).astype(float)


def frames(page: dict[str, Any]):
    """The frames of the page in the order of the recording: robot, velocity, ranges, pedestrians, goal, whether it is a first one."""
    beams, limit = page["world"]["laser"]["beams"], page["world"]["laser"]["range"]
    for episode in page["episodes"]:
        for run in episode["runs"]:
            robot = integers(run["robot"], 3) * [0.01, 0.01, 0.001]
            velocity = integers(run["command"], 2) * 0.001
            ranges = np.frombuffer(base64.b64decode(run["ranges"]), dtype=np.uint8).reshape(-1, beams) / 255 * limit
            walkers = integers(run["pedestrians"], 3 * len(run["speed_factors"]))
            for step in range(len(robot)):
                places = walkers[step].reshape(-1, 3)[:, :2] * 0.01
                yield robot[step], velocity[step], ranges[step], places, episode["goal"], step == 0


def check(topic: str, message: Any, frame: Any, limit: float) -> None:
    """Whether a message agrees with the page, as far as the page's numbers are rounded."""
    robot, velocity, ranges, places, goal, first = frame
    if topic == "/scan":
        assert message.header.frame_id == "laser" and len(message.ranges) == 512
        assert math.isclose(message.angle_increment, math.tau / 512, rel_tol=1e-6)
        kept = np.minimum(np.asarray(message.ranges)[::4], limit)
        np.testing.assert_allclose(kept, ranges, atol=limit / 255 / 2 + 1e-5)
    elif topic == "/odom":
        pose, twist = message.pose.pose, message.twist.twist
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        np.testing.assert_allclose([pose.position.x, pose.position.y], robot[:2], atol=0.0051)
        turn = 2 * math.atan2(pose.orientation.z, pose.orientation.w) - robot[2]
        assert abs(math.remainder(turn, math.tau)) < 0.00051
        np.testing.assert_allclose([twist.linear.x, twist.angular.z], velocity, atol=0.00051)
        assert len(message.pose.covariance) == 36
    elif topic == "/tf":
        chain = [(transform.header.frame_id, transform.child_frame_id) for transform in message.transforms]
        assert chain == [("map", "base_link"), ("base_link", "laser")]
    else:
        named = [(marker.ns, marker.pose.position) for marker in message.markers]
        assert [ns for ns, _ in named][:2] == (["", "walls"] if first else ["goal", "pedestrians"])
        found = [(at.x, at.y) for ns, at in named if ns == "pedestrians"]
        np.testing.assert_allclose(found, places, atol=0.0051)
        np.testing.assert_allclose([(at.x, at.y) for ns, at in named if ns == "goal"], [goal], atol=1e-5)


def check_all(replay: Replay, messages: Any) -> None:
    expected = {topic: frames(replay.page) for topic in TOPICS}
    limit = replay.page["world"]["laser"]["range"]
    for topic, message in messages:
        check(topic, message, next(expected[topic]), limit)
    for topic, rest in expected.items():
        assert next(rest, None) is None, f"{topic}: more frames are on the page than in the file"


def test_mcap_ros2_support_reads_what_is_on_the_page(replay: Replay) -> None:
    found = read_ros2_messages(replay.file)
    check_all(replay, ((message.channel.topic, message.ros_msg) for message in found))


def test_rosbags_reads_what_is_on_the_page(replay: Replay) -> None:
    with AnyReader([replay.file]) as reader:
        raw = reader.messages()
        check_all(replay, ((at.topic, reader.deserialize(data, at.msgtype)) for at, _, data in raw))


def test_both_readers_find_the_same_numbers(replay: Replay) -> None:
    one = [np.asarray(m.ros_msg.ranges, np.float32) for m in read_ros2_messages(replay.file, topics=["/scan"])]
    with AnyReader([replay.file]) as reader:
        scans = [at for at in reader.connections if at.topic == "/scan"]
        other = [reader.deserialize(data, at.msgtype).ranges for at, _, data in reader.messages(connections=scans)]
    assert len(one) > 100 and np.concatenate(one).tobytes() == np.concatenate(other).astype(np.float32).tobytes()


def test_metadata_names_the_episodes(replay: Replay) -> None:
    with replay.file.open("rb") as stream:
        found = [record.metadata for record in make_reader(stream).iter_metadata()]
    runs = [(run, episode) for episode in replay.page["episodes"] for run in episode["runs"]]
    assert [notes["driver"] for notes in found] == DRIVERS * EPISODES
    for notes, (run, episode) in zip(found, runs, strict=True):
        assert (notes["crowd"], notes["outcome"]) == (episode["crowd"], run["outcome"])
        assert int(notes["episode"]) == episode["episode"]
        assert int(notes["end"]) - int(notes["begin"]) == run["steps"] * 100_000_000
