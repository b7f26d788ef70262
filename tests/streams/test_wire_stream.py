"""The messages of the stream, snapshots and missed messages: golden bytes, malformed input."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import msgpack
import pytest

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeReplay, Changes, Frames
from zenoh_tf.errors import ProtocolError, ServerBusy

POSE = struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)
STREAM: dict[str, Any] = {
    "v": 1,
    "instance": "00",
    "first": 5,
    "last": 6,
    "clock_ns": 9,
}
CHANGES: dict[str, Any] = {
    "names": ["map", "base", "old"],
    "authorities": ["wheels"],
    "kind": b"\x00\x04",
    "frame": struct.pack("<2I", 1, 2),
    "version": struct.pack("<2Q", 8, 12),
    "parent": struct.pack("<I", 0),
    "authority": struct.pack("<I", 0),
    "stamp": struct.pack("<q", 7),
    "pose": POSE,
    "lost": b"",
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
    "frames": b"",
}
FRAMES: dict[str, Any] = {
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
        ({"real_ns": 1.0}, "real_ns"),
        ({"changes": []}, "changes"),
    ],
)
def test_malformed_stream_messages(change: dict[str, Any], field: str) -> None:
    with pytest.raises(ProtocolError) as error:
        wire.parse_stream({**STREAM, **change})
    assert error.value.field == field


@pytest.mark.parametrize(
    ("change", "field"),
    [
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
        ({"pose": "text"}, "pose"),
        ({"names": [b"map"]}, "names"),
        ({"names": ["\ud800"]}, "names"),
        ({"authorities": "wheels"}, "authorities"),
    ],
)
def test_malformed_changes(change: dict[str, Any], field: str) -> None:
    message = packed(CHANGES | change)
    for read in (Changes, lambda data: ChangeReplay(TransformTree()).apply(6, data)):
        with pytest.raises(ProtocolError) as error:
            read(message)
        assert error.value.field == field


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"seq": -1}, "seq"),
        ({"bounds": struct.pack("<I", 0)}, "bounds"),
        ({"bounds": struct.pack("<2I", 1, 0)}, "bounds"),
        ({"settings": {}}, "cache_ns"),
        ({"reparented": 1}, "reparented"),
        ({"changes": 1}, "changes"),
    ],
)
def test_malformed_plans(change: dict[str, Any], field: str) -> None:
    with pytest.raises(ProtocolError) as error:
        wire.parse_snapshot_plan({**PLAN, **change})
    assert error.value.field == field


@pytest.mark.parametrize("change", [{"piece": None}, {"reached": -1}, {"last": ""}, {"frames": 1}])
def test_malformed_pieces(change: dict[str, Any]) -> None:
    with pytest.raises(ProtocolError) as error:
        wire.parse_snapshot_piece({**PIECE, **change})
    assert error.value.field in change


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"count": struct.pack("<I", 2)}, "stamp"),
        ({"count": struct.pack("<I", (1 << 32) - 1)}, "stamp"),
        ({"frame": struct.pack("<I", 2)}, "frame"),
        ({"authority": struct.pack("<I", 1)}, "authority"),
        ({"parent": b""}, "parent"),
    ],
)
def test_malformed_frames(change: dict[str, Any], field: str) -> None:
    message = packed(FRAMES | change)
    for read in (Frames, ChangeReplay(TransformTree()).load):
        with pytest.raises(ProtocolError) as error:
            read(message)
        assert error.value.field == field


@pytest.mark.parametrize(
    ("fields", "read", "what"),
    [(CHANGES, Changes, "changes"), (FRAMES, Frames, "frames")],
)
def test_fields_have_their_order_and_others_may_follow(
    fields: dict[str, Any], read: Callable[[bytes], Changes | Frames], what: str
) -> None:
    message = packed(fields)
    for found in (read(message), read(packed(fields | {"new": [1, {}]}))):
        assert list(found.names) == fields["names"]
        assert found.stamp.tolist() == [7] and found.pose.tolist() == [[1, 2, 3, 0, 0, 0, 1]]
        assert not found.pose.flags.writeable
    for field, value in fields.items():
        rest = {name: other for name, other in fields.items() if name != field}
        for other in (rest, rest | {field: value}):
            if list(other) != list(fields):
                with pytest.raises(ProtocolError) as error:
                    read(packed(other))
                assert error.value.field == field
    for damaged in (b"", b"\x90", b"\xc1", message + b"\0"):
        with pytest.raises(ProtocolError) as error:
            read(damaged)
        assert error.value.field == what
    for size in range(1, len(message)):
        with pytest.raises(ProtocolError):
            read(message[:size])


def packed(fields: dict[str, Any]) -> bytes:
    data: bytes = msgpack.packb(fields, unicode_errors="surrogatepass")
    return data


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
