"""Messages with transforms as columns: ROS 2 and ROS 1 TFMessage, Foxglove's FrameTransforms.

A decoder turns the bytes of many messages into their rows.
Messages that cannot be decoded have no rows, and are counted.
"""

from __future__ import annotations

import importlib
import json
import struct
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final, NamedTuple

from .._core import TransformRows, decode_tf_messages
from .errors import reason
from .ros_types import full_type, ros_message


class Decoded(NamedTuple):
    """The rows of many messages."""

    rows: TransformRows
    counts: list[int]  # rows of each message
    malformed: int  # messages that cannot be decoded
    first_fault: str  # what is wrong with the first of them


Decode = Callable[[list[bytes]], Decoded]

#: The last two are of ROS 1, before and after 2013; its bags and MCAP files spell them differently.
_TF_MESSAGES: Final = frozenset(
    {"tf2_msgs/msg/TFMessage", "tf2_msgs/TFMessage", "tf/msg/tfMessage", "tf/tfMessage"}
)
_FRAME_TRANSFORMS: Final = ("foxglove.FrameTransforms", "foxglove.FrameTransform")
#: The same as packages of ROS have them.
_ROS_FRAME_TRANSFORMS: Final = (
    "foxglove_msgs/msg/FrameTransforms",
    "foxglove_msgs/msg/FrameTransform",
)
#: What can be read, for error messages.
READABLE: Final = "tf2_msgs/msg/TFMessage, foxglove.FrameTransforms or foxglove.FrameTransform"

_IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)


@cache
def decoder(message_type: str, encoding: str) -> Decode | None:
    """The decoder for a type or schema of messages in an encoding, which is "cdr", "ros1",
    "protobuf", "json" or "flatbuffer"; None if it has no transforms."""
    kinds: dict[str, Decode] = {}
    if message_type in _TF_MESSAGES:
        kinds = {"cdr": _cdr, "ros1": each(_ros1)}
    elif message_type in _FRAME_TRANSFORMS:
        kinds = {
            "protobuf": each(_protobuf(message_type)),
            "json": each(_json),
            "flatbuffer": each(_flatbuffer(message_type)),
        }
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


_MAX_STAMP: Final = 1 << 63
#: (parent, child, stamp in ns, pose of seven numbers)
Row = tuple[str, str, int, tuple[float, ...]]


def each(decode: Callable[[bytes], list[Row]]) -> Decode:
    """A decoder from one that decodes a message, and may raise any exception."""

    def decode_all(messages: list[bytes]) -> Decoded:
        parts: list[TransformRows] = []
        counts: list[int] = []
        malformed, fault = 0, ""
        for data in messages:
            counts.append(0)
            try:
                found = decode(data)
                parts.append(TransformRows.of_tuples([_checked(row) for row in found]))
                counts[-1] = len(found)
            except ImportError:
                raise
            except Exception as error:
                malformed += 1
                fault = fault or reason(error)
        return Decoded(TransformRows.join(parts), counts, malformed, fault)

    return decode_all


def _checked(row: Row) -> Row:
    """A row whose stamp beyond 64 bits of nanoseconds is one that a tree refuses by itself."""
    return row if abs(row[2]) < _MAX_STAMP else (*row[:2], -_MAX_STAMP, row[3])


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
    return _name(data[at + _LENGTH.size : end]), end


def _name(data: bytes) -> str:
    """A frame's name. One that is no UTF-8 gets a zero, which no frame's name has, so that a tree
    refuses the row and no other."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode(errors="backslashreplace") + "\0"


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


def _flatbuffer(message_type: str) -> Callable[[bytes], list[Row]]:
    """A decoder of a foxglove.FrameTransforms, or of a single FrameTransform, in flatbuffers."""
    name = message_type.rpartition(".")[2]

    def decode(data: bytes) -> list[Row]:
        schema = importlib.import_module(f"foxglove_schemas_flatbuffer.{name}")  # an extra
        message = getattr(schema, name).GetRootAs(data)
        if name == "FrameTransform":
            return [_flatbuffer_row(message)]
        count = message.TransformsLength()
        if count > len(data):
            raise ValueError("it has more transforms than bytes")
        return [_flatbuffer_row(message.Transforms(index)) for index in range(count)]

    return decode


def _flatbuffer_row(row: Any) -> Row:
    time, at, turn = row.Timestamp(), row.Translation(), row.Rotation()
    return (
        _name(row.ParentFrameId()),
        _name(row.ChildFrameId()),
        time.Sec() * 10**9 + time.Nsec(),
        (
            *((at.X(), at.Y(), at.Z()) if at else (0.0, 0.0, 0.0)),
            *((turn.X(), turn.Y(), turn.Z(), turn.W()) if turn else _IDENTITY),
        ),
    )


def _protobuf(message_type: str) -> Callable[[bytes], list[Row]]:
    """A decoder of a foxglove.FrameTransforms, or of a single FrameTransform, in protobuf."""
    name = message_type.rpartition(".")[2]

    def decode(data: bytes) -> list[Row]:
        schema = importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2")  # an extra
        message = getattr(schema, name).FromString(data)
        return [_protobuf_row(row) for row in getattr(message, "transforms", [message])]

    return decode


def _protobuf_row(row: Any) -> Row:
    at, turn = row.translation, row.rotation
    # A message that is left out is all zeros, which is no rotation.
    rotation = (turn.x, turn.y, turn.z, turn.w) if row.HasField("rotation") else _IDENTITY
    return (
        row.parent_frame_id,
        row.child_frame_id,
        row.timestamp.seconds * 10**9 + row.timestamp.nanos,
        (at.x, at.y, at.z, *rotation),
    )


def _json(data: bytes) -> list[Row]:
    """A foxglove.FrameTransforms, or a single FrameTransform, in JSON."""
    message = json.loads(data)
    return [_json_row(row) for row in message.get("transforms", [message])]


def _json_row(row: dict[str, Any]) -> Row:
    time, at, turn = row["timestamp"], row.get("translation"), row.get("rotation")
    translation = tuple(float(at[axis]) for axis in "xyz") if at else (0.0, 0.0, 0.0)
    rotation = tuple(float(turn[axis]) for axis in "xyzw") if turn else _IDENTITY
    parent, child = row["parent_frame_id"], row["child_frame_id"]
    if type(parent) is not str or type(child) is not str:
        raise ValueError("a frame id is no text")
    stamp_ns = int(time["sec"]) * 10**9 + int(time["nsec"])
    return parent, child, stamp_ns, (*translation, *rotation)
