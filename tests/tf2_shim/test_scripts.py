"""Whole scripts in processes of their own; of the first only an import line is changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from .conftest import FAKE_ROS

#: Where Debian puts the Python messages of ROS 1.
ROS_1 = Path("/usr/lib/python3/dist-packages")

AS_WRITTEN_FOR_TF2 = """
import rclpy
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from tf2_ros import (
    Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformException, TransformListener,
)


class Follower(Node):
    def __init__(self):
        super().__init__("follower", namespace="/robot")
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.tf_broadcaster = TransformBroadcaster(self)
        self.tf_static_broadcaster = StaticTransformBroadcaster(self)
        self.send_camera()
        self.steps = 0
        self.create_timer(0.1, self.step)

    def send_camera(self):
        t = TransformStamped()
        t.header.stamp = self.get_clock().now().to_msg()
        t.header.frame_id = "base"
        t.child_frame_id = "camera"
        t.transform.translation.z = 0.5
        t.transform.rotation.w = 1.0
        self.tf_static_broadcaster.sendTransform(t)

    def step(self):
        try:
            self.tf_buffer.lookup_transform("map", "nowhere", rclpy.time.Time())
        except TransformException as ex:
            self.get_logger().info(f"not yet: {type(ex).__name__}")

        now = self.get_clock().now()
        t = TransformStamped()
        t.header.stamp = now.to_msg()
        t.header.frame_id = "map"
        t.child_frame_id = "base"
        t.transform.translation.x = float(self.steps)
        self.tf_broadcaster.sendTransform(t)

        if self.tf_buffer.can_transform("map", "camera", now, timeout=Duration(seconds=20.0)):
            t = self.tf_buffer.lookup_transform(
                "map", "camera", rclpy.time.Time(), timeout=Duration(seconds=20.0)
            )
            p = t.transform.translation
            late = now.nanoseconds - rclpy.time.Time.from_msg(t.header.stamp).nanoseconds
            self.get_logger().info(f"camera at {p.x} {p.y} {p.z}, {late} ns old")

        point = PointStamped()
        point.header.stamp = now.to_msg()
        point.header.frame_id = "camera"
        point.point.x = 1.0
        p = self.tf_buffer.transform(point, "map", timeout=Duration(seconds=20.0)).point
        self.get_logger().info(f"point at {p.x} {p.y} {p.z}")
        self.steps += 1


def main():
    rclpy.init()
    node = Follower()
    for _ in range(3):
        rclpy.spin_once(node)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
"""

WITH_REAL_MESSAGES = f"""
import queue, sys
sys.path.append({str(ROS_1)!r})  # behind this Python's own packages
import genpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, WrenchStamped
from zenoh_tf_client.tf2 import (
    Buffer, TransformBroadcaster, TransformFilter, TransformListener, do_transform_wrench, fill
)

tf_buffer = Buffer(genpy.Duration(10.0))
listener = TransformListener(tf_buffer)
t = TransformStamped()
t.header.stamp = genpy.Time(2, 500_000_000)
t.header.frame_id = "world"
t.child_frame_id = "rover"
t.transform.translation.x = 1.0
t.transform.rotation.w = 1.0
TransformBroadcaster().sendTransform(t)
got = tf_buffer.lookup_transform("world", "rover", t.header.stamp, genpy.Duration(20.0))
assert fill(TransformStamped(), got) == t, got

p = PoseWithCovarianceStamped()
p.header.frame_id = "rover"
p.header.stamp = genpy.Time(2, 500_000_000)
p.pose.pose.orientation.w = 1.0
p = tf_buffer.transform(p, "world", genpy.Duration(20.0))
p._check_types()

w = WrenchStamped()
w.header.frame_id, w.header.stamp = "rover", genpy.Time(2, 500_000_000)
w.wrench.force.y = 2.0
found = queue.SimpleQueue()
filter = TransformFilter(None, tf_buffer, "world", 5)
filter.registerCallback(lambda *arguments: found.put(arguments))
filter.add(w)
w = do_transform_wrench(*found.get(timeout=20))
w._check_types()
assert (w.header.frame_id, w.wrench.torque.z) == ("world", 2.0), w
print(p.header.frame_id, p.header.stamp.secs, p.header.stamp.nsecs, p.pose.pose.position.x)
"""

ENDS_AT_ONCE = """
from zenoh_tf_client.tf2 import (
    Buffer, MessageFilter, Time, TransformBroadcaster, TransformStamped
)

sent = TransformStamped()
sent.header.frame_id, sent.header.stamp, sent.child_frame_id = "port", Time(1), "ship"
held = MessageFilter(None, Buffer(), "never", 10)
held.add(sent)
waits = [Buffer().wait_for_transform_async("port", "never", Time()) for _ in range(3)]
TransformBroadcaster().sendTransform(sent)
"""


def run(server: Any, script: str, *folders: Path) -> list[str]:
    environment = os.environ | {
        "ZENOH_TF_CONNECT": server.endpoint,
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
    }
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.splitlines()


def test_a_script_for_tf2_with_another_import_line(shared_server: Any) -> None:
    assert AS_WRITTEN_FOR_TF2.count("tf2_ros") == 1
    script = AS_WRITTEN_FOR_TF2.replace("from tf2_ros import", "from zenoh_tf_client.tf2 import")
    lines = run(shared_server, script, FAKE_ROS)
    assert lines == [
        line
        for step in (0.0, 1.0, 2.0)
        for line in (
            "not yet: LookupException",
            f"camera at {step} 0.0 0.5, 0 ns old",
            f"point at {step + 1.0} 0.0 0.5",
        )
    ]
    with shared_server.connect() as tf:
        assert tf.frame("camera").authority == "/robot/follower"


def test_the_modules_have_tf2_ros_names() -> None:
    from zenoh_tf_client import tf2  # noqa: PLC0415
    from zenoh_tf_client.tf2.buffer import Buffer  # noqa: PLC0415
    from zenoh_tf_client.tf2.static_transform_broadcaster import (  # noqa: PLC0415
        StaticTransformBroadcaster,
    )
    from zenoh_tf_client.tf2.transform_broadcaster import TransformBroadcaster  # noqa: PLC0415
    from zenoh_tf_client.tf2.transform_listener import TransformListener  # noqa: PLC0415

    for kind in (Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener):
        assert getattr(tf2, kind.__name__) is kind


def test_no_module_of_ros_is_imported(shared_server: Any) -> None:
    lines = run(
        shared_server,
        "import sys, zenoh_tf_client.tf2\n"
        "print([n for n in sys.modules if n.split('.')[0] in "
        "('rclpy', 'tf2_ros', 'tf2_py', 'geometry_msgs', 'builtin_interfaces', 'genpy')])",
        FAKE_ROS,
    )
    assert lines == ["[]"]


@pytest.mark.skipif(
    not (ROS_1 / "geometry_msgs").is_dir(), reason=f"no geometry_msgs of ROS 1 in {ROS_1}"
)
def test_real_messages_of_ros_1(shared_server: Any) -> None:
    assert run(shared_server, WITH_REAL_MESSAGES) == ["world 2 500000000 1.0"]


def test_a_script_may_end_at_any_time(shared_server: Any) -> None:
    """What it sent arrives, and waits that are under way do not hold it."""
    run(shared_server, ENDS_AT_ONCE)
    with shared_server.connect() as tf:
        assert tf.can_transform("port", "ship", timeout_s=20.0)
