"""Foxglove's FrameTransforms and FrameTransform, in protobuf, flatbuffers and JSON.

Protobuf and flatbuffers need the schemas of the extra `recordings`.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from typing import Any, Final

from .rows import Decode, Row, each, name_of

SCHEMAS: Final = ("foxglove.FrameTransforms", "foxglove.FrameTransform")
_IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)


def decoders(schema: str) -> dict[str, Decode]:
    """The decoders of one of `SCHEMAS`, by the encoding."""
    return {
        "protobuf": each(_protobuf(schema)),
        "json": each(_json),
        "flatbuffer": each(_flatbuffer(schema)),
    }


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
        name_of(row.ParentFrameId()),
        name_of(row.ChildFrameId()),
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
