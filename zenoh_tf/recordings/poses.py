"""Messages with one pose as columns: TransformStamped, Odometry, PoseStamped of ROS 2 and ROS 1.

They are decoded with ``rosbags``, and read only if their topic is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from .decoders import Decode, Row, each
from .errors import missing_library

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
    package, _, name = message_type.partition("/")
    full = f"{package}/msg/{name.removeprefix('msg/')}"
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


def ros_message(message_type: str, encoding: str, data: bytes) -> Any:
    """A message of ROS. Raises any exception if it is malformed."""
    return _deserializer(encoding)(data, message_type)


@cache
def _deserializer(encoding: str) -> Callable[[bytes, str], Any]:
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise missing_library(error) from error
    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    return store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
