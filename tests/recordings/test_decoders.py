"""Decoding many messages at once gives what decoding each gives."""

from __future__ import annotations

import random
import struct

import pytest

from zenoh_tf import TransformTree
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import ProtocolError
from zenoh_tf.recordings.decoders import decoder
from zenoh_tf.ros2.cdr import decode_tf_message, encode_tf_message

from .readers import rows


def messages(seed: int) -> list[bytes]:
    """Messages of some frames, every third of them spoiled."""
    seeded = random.Random(seed)
    found = []
    for _ in range(seeded.randrange(1, 30)):
        count = seeded.randrange(4)
        names = seeded.sample(["map", "odom", "base", "größe", "a" * 40, ""], 3)
        sent = [
            (
                seeded.choice(names),
                seeded.choice(names),
                seeded.randrange(-(2**31), 2**31) * 10**9,
                [seeded.random() for _ in range(7)],
            )
            for _ in range(count)
        ]
        data = bytearray(encode_tf_message(TransformRows.of_tuples(sent)))
        if seeded.random() < 0.3:
            data[seeded.randrange(len(data))] = seeded.choice((0, 1, 0x80, 0xFF))
        if seeded.random() < 0.1:
            del data[seeded.randrange(len(data)) :]
        found.append(bytes(data))
    return found


def test_many_messages_of_which_some_are_malformed() -> None:
    decode = decoder("tf2_msgs/msg/TFMessage", "cdr")
    assert decode is not None
    all_malformed = all_rows = 0
    for seed in range(500):
        batch = messages(seed)
        expected, malformed, first_fault = [], 0, ""
        for data in batch:
            try:
                expected += rows(decode_tf_message(data))
            except ProtocolError as error:
                malformed += 1
                first_fault = first_fault or str(error)
        found = decode(batch)
        assert repr(rows(found.rows)) == repr(expected)  # as NaN is not equal to itself
        assert (found.malformed, found.first_fault) == (malformed, first_fault)
        assert len(found.rows.names) == len(set(found.rows.names))
        all_malformed += malformed
        all_rows += len(expected)
    assert all_malformed > 300
    assert all_rows > 1000


def test_no_messages() -> None:
    for message_type, encoding in (("tf2_msgs/msg/TFMessage", "ros1"), ("tf/tfMessage", "cdr")):
        decode = decoder(message_type, encoding)
        assert decode is not None
        assert decode([]).rows.pose.shape == (0, 7)


def test_other_types_have_no_transforms() -> None:
    assert decoder("std_msgs/msg/String", "cdr") is None
    assert decoder("tf2_msgs/msg/TFMessage", "json") is None


def test_numbers_of_json_may_be_anything() -> None:
    decode = decoder("foxglove.FrameTransform", "json")
    assert decode is not None
    good = b'{"timestamp": {"sec": 1, "nsec": 5}, "parent_frame_id": "a", "child_frame_id": "b"}'
    bad = [
        good.replace(b'"sec": 1', text)
        for text in (b'"sec": 1e300', b'"sec": null', b'"sec": "x"', b'"sec": 99999999999999')
    ]
    found = decode([good, *bad, good.replace(b'"a"', b"7"), b"[]", b"\xff", b"", good])
    assert found.malformed == 6
    pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    stamps = (
        1_000_000_005,
        -(2**63),
        -(2**63),
        1_000_000_005,
    )
    assert rows(found.rows) == [("a", "b", stamp_ns, *pose) for stamp_ns in stamps]


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize("bad", [b"arm\xe4", b"ar\0m", b"\xc3\x28rm"])
def test_a_name_that_is_no_text_costs_its_row(encoding: str, bad: bytes) -> None:
    decode = decoder("tf2_msgs/msg/TFMessage", encoding)
    assert decode is not None
    pose = struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1)
    data = b"\0\1\0\0" if encoding == "cdr" else b""
    data += struct.pack("<I", 3)
    for child in (b"left", bad, b"right"):
        end = b"\0" if encoding == "cdr" else b""
        data += struct.pack("<2I", 5, 0) if end else struct.pack("<3I", 0, 5, 0)
        for name in (b"map", child):
            data += bytes(-len(data) % 4) if end else b""
            data += struct.pack("<I", len(name + end)) + name + end
        data += bytes((4 - len(data)) % 8) if end else b""
        data += pose
    found = decode([data])
    assert (found.malformed, found.counts) == (0, [3])
    tree = TransformTree()
    stored = tree._commit_rows(found.rows, drop_bad=True)
    assert tree.frames() == ["left", "map", "right"] and list(stored) == [1, 17, 1]
