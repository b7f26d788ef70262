"""Messages with transforms as columns: ROS 2 and ROS 1 TFMessage, Foxglove's FrameTransforms.

A decoder takes the bytes of a message and returns `TfMessage`, the columns of a commit. Bytes that
are no such message raise an exception of any kind.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ..ros2.cdr import TfMessage, decode_tf_message

Decode = Callable[[bytes], TfMessage]

#: The last two are of ROS 1, before and after 2013; its bags and MCAP files spell them differently.
_TF_MESSAGES: Final = frozenset(
    {"tf2_msgs/msg/TFMessage", "tf2_msgs/TFMessage", "tf/msg/tfMessage", "tf/tfMessage"}
)
_FRAME_TRANSFORMS: Final = "foxglove.FrameTransforms"
_FRAME_TRANSFORM: Final = "foxglove.FrameTransform"
#: What can be read, for error messages.
READABLE: Final = "tf2_msgs/msg/TFMessage, foxglove.FrameTransforms or foxglove.FrameTransform"

_IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)


def decoder(message_type: str, encoding: str) -> Decode | None:
    """The decoder for a type of message in an encoding; None if it has no transforms.

    Args:
        message_type: The name of the type, or of the schema.
        encoding: "cdr", "ros1", "protobuf" or "json".
    """
    kinds: dict[str, Decode] = {}
    if message_type in _TF_MESSAGES:
        kinds = {"cdr": decode_tf_message, "ros1": decode_ros1}
    elif message_type == _FRAME_TRANSFORMS:
        kinds = {"protobuf": decode_frame_transforms, "json": decode_json}
    elif message_type == _FRAME_TRANSFORM:
        kinds = {"protobuf": decode_frame_transform, "json": decode_json_one}
    return kinds.get(encoding)


def _columns(rows: list[tuple[str, str, int, Any]]) -> TfMessage:
    """Rows of (parent, child, stamp in ns, pose of seven numbers) as columns."""
    index: dict[str, int] = {}
    for parent, child, _, _ in rows:
        index.setdefault(parent, len(index))
        index.setdefault(child, len(index))
    count = len(rows)
    return TfMessage(
        [*index],
        np.fromiter((index[row[0]] for row in rows), np.uint32, count),
        np.fromiter((index[row[1]] for row in rows), np.uint32, count),
        np.fromiter((row[2] for row in rows), np.int64, count),
        np.array([row[3] for row in rows], np.float64).reshape(count, 7),
    )


_STAMP_ROS1: Final = struct.Struct("<III")  # sequence number, seconds, nanoseconds
_LENGTH: Final = struct.Struct("<I")
_POSE: Final = struct.Struct("<7d")


def decode_ros1(data: bytes) -> TfMessage:
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
    return _columns(rows)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and the place behind it."""
    (size,) = _LENGTH.unpack_from(data, at)
    end = at + _LENGTH.size + size
    if end > len(data):
        raise ValueError("a text is longer than its message")
    return data[at + _LENGTH.size : end].decode(), end


def decode_frame_transforms(data: bytes) -> TfMessage:
    """A foxglove.FrameTransforms in protobuf."""
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import (  # noqa: PLC0415 - an extra
        FrameTransforms,
    )

    return _columns([_protobuf_row(row) for row in FrameTransforms.FromString(data).transforms])


def decode_frame_transform(data: bytes) -> TfMessage:
    """A foxglove.FrameTransform in protobuf."""
    from foxglove_schemas_protobuf.FrameTransform_pb2 import (  # noqa: PLC0415 - an extra
        FrameTransform,
    )

    return _columns([_protobuf_row(FrameTransform.FromString(data))])


def _protobuf_row(row: Any) -> tuple[str, str, int, Any]:
    at, turn = row.translation, row.rotation
    # A message that is left out is all zeros, which is no rotation.
    rotation = (turn.x, turn.y, turn.z, turn.w) if row.HasField("rotation") else _IDENTITY
    return (
        row.parent_frame_id,
        row.child_frame_id,
        row.timestamp.seconds * 10**9 + row.timestamp.nanos,
        (at.x, at.y, at.z, *rotation),
    )


def decode_json(data: bytes) -> TfMessage:
    """A foxglove.FrameTransforms in JSON."""
    return _columns([_json_row(row) for row in json.loads(data)["transforms"]])


def decode_json_one(data: bytes) -> TfMessage:
    """A foxglove.FrameTransform in JSON."""
    return _columns([_json_row(json.loads(data))])


def _json_row(row: dict[str, Any]) -> tuple[str, str, int, Any]:
    time, at, turn = row["timestamp"], row.get("translation"), row.get("rotation")
    translation = tuple(at[axis] for axis in "xyz") if at else (0.0, 0.0, 0.0)
    rotation = tuple(turn[axis] for axis in "xyzw") if turn else _IDENTITY
    parent, child = row["parent_frame_id"], row["child_frame_id"]
    if type(parent) is not str or type(child) is not str:
        raise ValueError("a frame id is no text")
    return parent, child, time["sec"] * 10**9 + time["nsec"], (*translation, *rotation)
