"""The messages of the stream, snapshots and missed messages: golden bytes, malformed input."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from zenoh_tf import wire
from zenoh_tf.errors import ProtocolError, ServerBusy

POSE = struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)
STREAM: dict[str, Any] = {
    "v": 1,
    "instance": "00",
    "first": 5,
    "last": 6,
    "clock_ns": 9,
    "names": ["map", "base", "old"],
    "authorities": ["wheels"],
    "kind": b"\x00\x04",
    "frame": struct.pack("<2I", 1, 2),
    "version": struct.pack("<2Q", 8, 12),
    "parent": struct.pack("<I", 0),
    "authority": struct.pack("<I", 0),
    "stamp": struct.pack("<q", 7),
    "pose": POSE,
}
PLAN: dict[str, Any] = {
    "v": 1,
    "instance": "00",
    "seq": 5,
    "reparented": True,
    "bounds": struct.pack("<3I", 0, 2, 3),
    "settings": {
        "cache_ns": 10,
        "max_frames": 64,
        "max_samples_per_frame": 16,
        "max_name_bytes": 255,
        "max_depth": 1000,
    },
    "clock_ns": 9,
}
PIECE: dict[str, Any] = {
    "v": 1,
    "instance": "00",
    "piece": 1,
    "reached": 3,
    "last": 6,
    "names": ["base", "map"],
    "authorities": ["wheels"],
    "frame": struct.pack("<I", 0),
    "version": struct.pack("<Q", 8),
    "static": b"\x00",
    "authority": struct.pack("<I", 0),
    "count": struct.pack("<I", 1),
    "stamp": struct.pack("<q", 7),
    "parent": struct.pack("<I", 1),
    "pose": POSE,
}


def test_a_stream_without_orphans_has_no_field_of_them() -> None:
    """Names lose their ids only at the limit of frames: other messages have no `lost`."""
    data = wire.pack(STREAM)
    message = wire.parse_stream(wire.unpack(data))
    assert wire.pack(wire.stream_body(message)) == data


def test_an_error_in_a_reply_is_raised() -> None:
    body = wire.unpack(wire.pack(wire.error_reply("00", ServerBusy("busy"))))
    for parse in (wire.parse_snapshot_plan, wire.parse_snapshot_piece, wire.parse_missed_reply):
        with pytest.raises(ServerBusy):
            parse(body)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"instance": 1}, "instance"),
        ({"first": 0}, "first"),
        ({"last": 3}, "last"),
        ({"clock_ns": None}, "clock_ns"),
        ({"kind": b"\x00\x07"}, "kind"),
        ({"kind": b"\x00\x00"}, "parent"),
        ({"kind": b"\x00\x06"}, "lost"),
        ({"kind": b"\x00\x06", "lost": struct.pack("<I", 3)}, "lost"),
        ({"kind": b"\x00\x06", "lost": struct.pack("<2I", 1, 1)}, "lost"),
        ({"frame": struct.pack("<2I", 1, 3)}, "frame"),
        ({"frame": struct.pack("<I", 1)}, "frame"),
        ({"version": b"12345678"}, "version"),
        ({"parent": struct.pack("<I", 3)}, "parent"),
        ({"authority": struct.pack("<I", 1)}, "authority"),
        ({"stamp": b""}, "stamp"),
        ({"pose": POSE[8:]}, "pose"),
        ({"names": [b"map"]}, "names"),
        ({"authorities": "wheels"}, "authorities"),
    ],
)
def test_malformed_stream_messages(change: dict[str, Any], field: str) -> None:
    with pytest.raises(ProtocolError) as error:
        wire.parse_stream({**STREAM, **change})
    assert error.value.field == field


@pytest.mark.parametrize(
    ("body", "change", "field"),
    [
        (PLAN, {"seq": -1}, "seq"),
        (PLAN, {"bounds": struct.pack("<I", 0)}, "bounds"),
        (PLAN, {"bounds": struct.pack("<2I", 1, 0)}, "bounds"),
        (PLAN, {"settings": {}}, "cache_ns"),
        (PLAN, {"reparented": 1}, "reparented"),
        (PIECE, {"piece": None}, "piece"),
        (PIECE, {"count": struct.pack("<I", 2)}, "stamp"),
        (PIECE, {"count": struct.pack("<I", (1 << 32) - 1)}, "stamp"),
        (PIECE, {"frame": struct.pack("<I", 2)}, "frame"),
        (PIECE, {"authority": struct.pack("<I", 1)}, "authority"),
        (PIECE, {"parent": b""}, "parent"),
    ],
)
def test_malformed_snapshots(body: dict[str, Any], change: dict[str, Any], field: str) -> None:
    parse = wire.parse_snapshot_plan if body is PLAN else wire.parse_snapshot_piece
    with pytest.raises(ProtocolError) as error:
        parse({**body, **change})
    assert error.value.field == field


def test_columns_are_views_of_the_message() -> None:
    message = wire.parse_stream(wire.unpack(wire.pack(STREAM)))
    assert message.changes is not None
    assert not message.changes.pose.flags.writeable
    assert message.changes.pose.dtype == np.float64


def test_an_interest() -> None:
    """Golden bytes: the id names the stream, so every implementation must compute the same."""
    interest = wire.Interest.of([("map", "base"), ("arm", "map"), ("base", "map")], 0, 50_000_000)
    assert interest.pairs == (("arm", "map"), ("base", "map"))
    assert interest.id == "eb3115decec867bcea1fab3968b3fcd3"
    assert interest == wire.Interest.of([("map", "arm"), ("base", "map")], 0, 50_000_000)
    body = wire.unpack(wire.pack({"v": 1, "interest": interest.fields()}))
    assert wire.parse_interest(body) == interest
    assert wire.parse_interest({"v": 1}) is None
    assert body["interest"]["names"] == ["arm", "base", "map"]
    assert bytes(body["interest"]["target"]) == bytes([0, 0, 0, 0, 1, 0, 0, 0])
    assert bytes(body["interest"]["source"]) == bytes([2, 0, 0, 0, 2, 0, 0, 0])
