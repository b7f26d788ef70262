"""Messages with one pose as columns: TransformStamped, Odometry, PoseStamped of ROS 2 and ROS 1.

They are decoded with ``rosbags``, and read only if their topic is asked for.
"""

from __future__ import annotations

from typing import Final

from ..formats.rows import Decode, Row, each
from .ros_types import full_type, ros_message

_TRANSFORM: Final = "geometry_msgs/msg/TransformStamped"
_ODOMETRY: Final = "nav_msgs/msg/Odometry"
_POSE: Final = "geometry_msgs/msg/PoseStamped"
_POSE_COVARIANCE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
_TYPES: Final = frozenset({_TRANSFORM, _ODOMETRY, _POSE, _POSE_COVARIANCE})


def pose_decoder(message_type: str, encoding: str, topic: str) -> Decode | None:
    """The decoder of a type with one pose; None for another type.

    Args:
        message_type: As the recording has it, with or without "/msg/".
        encoding: "cdr" or "ros1".
        topic: Without a slash at its begin: the child of messages that name no child.
    """
    full = full_type(message_type)
    if full not in _TYPES or encoding not in ("cdr", "ros1"):
        return None

    def decode(data: bytes) -> list[Row]:
        message = ros_message(full, encoding, data)
        stamp = message.header.stamp
        if full == _TRANSFORM:
            at, turn = message.transform.translation, message.transform.rotation
        else:
            pose = message.pose if full == _POSE else message.pose.pose
            at, turn = pose.position, pose.orientation
        child = topic if full in (_POSE, _POSE_COVARIANCE) else message.child_frame_id
        return [
            (
                message.header.frame_id,
                child,
                stamp.sec * 10**9 + stamp.nanosec,
                (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w),
            )
        ]

    return each(decode)
