"""Messages and times for the tests, as scripts make them."""

from __future__ import annotations

from .fake_ros.geometry_msgs import msg
from .fake_ros.rclpy.duration import Duration
from .fake_ros.rclpy.time import Time

Pose = tuple[float, float, float]
Turn = tuple[float, float, float, float]


def link(
    parent: str,
    child: str,
    seconds: float,
    xyz: Pose = (0.0, 0.0, 0.0),
    turn: Turn = (0.0, 0.0, 0.0, 1.0),
) -> msg.TransformStamped:
    message = msg.TransformStamped()
    message.header.stamp = Time(seconds=seconds).to_msg()
    message.header.frame_id = parent
    message.child_frame_id = child
    shift, rotation = message.transform.translation, message.transform.rotation
    shift.x, shift.y, shift.z = xyz
    rotation.x, rotation.y, rotation.z, rotation.w = turn
    return message


def at(seconds: float) -> Time:
    return Time(seconds=seconds)


def lasting(seconds: float) -> Duration:
    return Duration(seconds=seconds)


LATEST = Time()
