"""Messages with transforms as columns: ROS 2 and ROS 1 TFMessage, Foxglove's FrameTransforms.

A decoder turns the bytes of many messages into their rows.
Messages that cannot be decoded have no rows, and are counted.
"""

from __future__ import annotations

import struct
from functools import cache, partial
from typing import Any, Final

from .._core import decode_tf_messages
from ..formats import foxglove
from ..formats.rows import Decode, Decoded, Row, each, name_of
from .ros_types import full_type, ros_message

#: The last two are of ROS 1, before and after 2013; its bags and MCAP files spell them differently.
_TF_MESSAGES: Final = frozenset(
    {"tf2_msgs/msg/TFMessage", "tf2_msgs/TFMessage", "tf/msg/tfMessage", "tf/tfMessage"}
)
#: Foxglove's as packages of ROS have them.
_ROS_FRAME_TRANSFORMS: Final = (
    "foxglove_msgs/msg/FrameTransforms",
    "foxglove_msgs/msg/FrameTransform",
)
#: What can be read, for error messages.
READABLE: Final = "tf2_msgs/msg/TFMessage, foxglove.FrameTransforms or foxglove.FrameTransform"


@cache
def decoder(message_type: str, encoding: str) -> Decode | None:
    """The decoder for a type or schema of messages in an encoding, which is "cdr", "ros1",
    "protobuf", "json" or "flatbuffer"; None if it has no transforms."""
    kinds: dict[str, Decode] = {}
    if message_type in _TF_MESSAGES:
        kinds = {"cdr": _cdr, "ros1": each(_ros1)}
    elif message_type in foxglove.SCHEMAS:
        kinds = foxglove.decoders(message_type)
    elif (name := full_type(message_type)) in _ROS_FRAME_TRANSFORMS:
        kinds = {form: each(partial(_ros, name, form)) for form in ("cdr", "ros1")}
    return kinds.get(encoding)


def _cdr(messages: list[bytes]) -> Decoded:
    """tf2_msgs/TFMessage of ROS 2."""
    rows, malformed, field, expected = decode_tf_messages(messages)
    if malformed:
        counts = [len(decode_tf_messages([data])[0]) for data in messages]
        return Decoded(rows, counts, malformed, f"CDR field {field} must be {expected}")
    return Decoded(rows, [_cdr_count(data) for data in messages], 0, "")


def _cdr_count(data: bytes) -> int:
    """How many transforms a valid message has: the length of the sequence is behind the header,
    whose second byte is the order of the bytes."""
    return int.from_bytes(data[4:8], "little" if data[1] & 1 else "big")


_STAMP_ROS1: Final = struct.Struct("<III")  # sequence number, seconds, nanoseconds
_LENGTH: Final = struct.Struct("<I")
_POSE: Final = struct.Struct("<7d")


def _ros1(data: bytes) -> list[Row]:
    """A tf2_msgs/TFMessage as ROS 1 serializes it: as CDR, but packed and with `seq`."""
    (count,) = _LENGTH.unpack_from(data)
    at = _LENGTH.size
    rows = []
    for _ in range(count):
        _, seconds, rest = _STAMP_ROS1.unpack_from(data, at)
        parent, at = _text(data, at + _STAMP_ROS1.size)
        child, at = _text(data, at)
        rows.append((parent, child, seconds * 10**9 + rest, _POSE.unpack_from(data, at)))
        at += _POSE.size
    return rows


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and the place behind it."""
    (size,) = _LENGTH.unpack_from(data, at)
    end = at + _LENGTH.size + size
    if end > len(data):
        raise ValueError("a text is longer than its message")
    return name_of(data[at + _LENGTH.size : end]), end


def _ros(message_type: str, encoding: str, data: bytes) -> list[Row]:
    """Foxglove's messages as packages of ROS have them."""
    message = ros_message(message_type, encoding, data)
    return [
        (
            row.parent_frame_id,
            row.child_frame_id,
            row.timestamp.sec * 10**9 + row.timestamp.nanosec,
            _pose(row.translation, row.rotation),
        )
        for row in getattr(message, "transforms", [message])
    ]


def _pose(at: Any, turn: Any) -> tuple[float, ...]:
    return (at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)
