"""Plain classes with the fields of ROS's messages, and conversions between them and the SDK.

Arguments may be any object with these attributes, such as ROS's own messages. Results are of the
classes of this module; `fill` copies one into a message of ROS's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from operator import attrgetter
from typing import Any, TypeVar

import zenoh_tf
from zenoh_tf import StampedTransform
from zenoh_tf.errors import InvalidArgumentException, WrongType

from .times import Duration, Time, nanoseconds, stamp_ns, time_of

M = TypeVar("M")


@dataclass(slots=True)
class Header:
    """A time and the frame that a message is expressed in."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass(slots=True)
class Vector3:
    """Metres."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(slots=True)
class Quaternion:
    """A unit quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass(slots=True)
class Transform:
    """Maps coordinates in the child frame to coordinates in the parent frame."""

    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class TransformStamped:
    """The pose of `child_frame_id` in `header.frame_id` at `header.stamp`."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass(slots=True)
class Point:
    """A position, in metres."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass(slots=True)
class Pose:
    """A position and an orientation."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass(slots=True)
class PointStamped:
    """A point in `header.frame_id` at `header.stamp`."""

    header: Header = field(default_factory=Header)
    point: Point = field(default_factory=Point)


@dataclass(slots=True)
class PoseStamped:
    """A pose in `header.frame_id` at `header.stamp`."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


def fill(message: M, values: Any) -> M:
    """Copy a result into a message of ROS's, or of any class with the same attributes.

    Args:
        message: The message to write to.
        values: An object of a class of this module.

    Returns:
        `message`.

    Example:
        ``fill(geometry_msgs.msg.TransformStamped(), result)``
    """
    if isinstance(values, Time | Duration) and hasattr(message, "nsecs"):  # ROS 1
        message.secs, message.nsecs = values.sec, values.nanosec  # type: ignore[attr-defined]
        return message
    for each in fields(values):
        value = getattr(values, each.name)
        if is_dataclass(value):
            fill(getattr(message, each.name), value)
        else:
            setattr(message, each.name, value)
    return message


def transform_of(message: Any) -> zenoh_tf.Transform:
    """Return the transform in a TransformStamped, ``X_parent_child``."""
    t, q = message.transform.translation, message.transform.rotation
    return zenoh_tf.Transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


def stamped_of(message: Any) -> StampedTransform:
    """Convert a TransformStamped to the SDK's class.

    Raises InvalidArgumentException, which names the field at fault.
    """
    try:
        return StampedTransform(
            message.header.frame_id,
            message.child_frame_id,
            nanoseconds(message.header.stamp, "header.stamp"),
            transform_of(message),
        )
    except (AttributeError, TypeError, InvalidArgumentException) as error:
        _check_name(message, "header.frame_id")
        _check_name(message, "child_frame_id")
        if isinstance(error, InvalidArgumentException):
            raise
        raise WrongType(f"transform is no TransformStamped: {error}", field="transform") from error


def header_of(message: Any) -> Any:
    """Return a message's header. Raises InvalidArgumentException, which names a wrong field."""
    _check_name(message, "header.frame_id")
    stamp_ns(getattr(message.header, "stamp", None), "header.stamp")
    return message.header


def _check_name(message: Any, field: str) -> None:
    try:
        name = attrgetter(field)(message)
    except AttributeError:
        raise WrongType(f"a {type(message).__name__} has no {field}", field=field) from None
    if not isinstance(name, str):
        raise WrongType(f"{field} must be a str, not {name!r}", field=field)


def message_of(stamped: StampedTransform) -> TransformStamped:
    """Convert the result of a lookup to a message."""
    x, y, z, qx, qy, qz, qw = stamped.transform.pose()
    return TransformStamped(
        Header(time_of(stamped.stamp_ns), stamped.parent_frame),
        stamped.child_frame,
        Transform(Vector3(x, y, z), Quaternion(qx, qy, qz, qw)),
    )


def with_header(message: M, transform: Any) -> M:
    """Give a transformed message the frame that the transform maps to, and its time."""
    header = transform.header
    values = Header(time_of(nanoseconds(header.stamp)), header.frame_id)
    fill(message.header, values)  # type: ignore[attr-defined]
    return message
