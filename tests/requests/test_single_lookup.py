"""The messages of a lookup of one row: those of the native module are those of `wire`."""

from __future__ import annotations

import pytest

from zenoh_tf import StampedTransform, Transform, TransformTree, _core, wire
from zenoh_tf.errors import InvalidArgumentException


@pytest.mark.parametrize("length", [1, 31, 32, 255, 256, 70_000])
def test_the_native_module_packs_a_single_read_as_msgpack_does(length: int) -> None:
    names = "a" * length, "\N{BIRD}" * (length // 4)
    packed = wire.pack_one_read(*names, wire.OP_LATEST_XACT, wire.NO_STAMP)
    assert packed == wire.pack(wire.one_read(*names, wire.OP_LATEST_XACT, wire.NO_STAMP))


def test_a_name_that_cannot_be_sent_is_refused_by_both() -> None:
    with pytest.raises(InvalidArgumentException):
        wire.pack_one_read("\udc80", "b", wire.OP_AT, 7)


@pytest.mark.parametrize("op", [wire.OP_AT, wire.OP_COMMON, wire.OP_LATEST, wire.OP_LATEST_XACT])
def test_the_native_module_replies_to_a_single_read_as_the_server_does(op: int) -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 7, Transform((1, 2, 3), (0, 0, 0, 1))))
    message = wire.pack_one_read("map", "base", op, 7 if op == wire.OP_AT else wire.NO_STAMP)
    reply = _core.reply_to_lookup(tree, message, "00")
    assert reply is not None
    pose = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    latest = op in (wire.OP_LATEST, wire.OP_LATEST_XACT)
    expected = wire.one_answer(7, 7 if latest else None, pose) | {"v": 1, "instance": "00"}
    assert reply == wire.pack(expected)
    answer = _core.parse_single_answer(reply, "00")
    assert answer is not None
    assert answer[:2] == (7, 7) and answer[2] == Transform((1, 2, 3), (0, 0, 0, 1))
    assert _core.parse_single_answer(reply, "01") is None
    for end in range(len(reply)):
        assert _core.parse_single_answer(reply[:end], "00") is None
        assert _core.parse_single_answer(reply[:end] + b"\xc1" + reply[end:], "00") is None


def test_the_native_module_leaves_other_reads_to_the_server() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 7, Transform((1, 2, 3), (0, 0, 0, 1))))
    good = wire.one_read("map", "base", wire.OP_AT, 7)
    others = [
        wire.one_read("map", "other", wire.OP_AT, 7),  # fails
        wire.one_read("/map", "base", wire.OP_AT, 7),  # no lookup may name a frame so
        wire.one_read("map", "/base", wire.OP_AT, 7),
        wire.one_read("map", "base", wire.OP_AT, wire.NO_STAMP),
        wire.one_read("map", "base", wire.OP_COMMON_TIME, wire.NO_STAMP),
        good | {"op": b"\xff"},
        good | {"atomic": True},
        good | {"v": 2},
        good | {"target": b"\2\0\0\0"},
        {name: good[name] for name in reversed(good)},
    ]
    for other in others:
        assert _core.reply_to_lookup(tree, wire.pack(other), "00") is None, other
    packed = wire.pack(good)
    assert _core.reply_to_lookup(tree, packed, "00") is not None
    for end in range(len(packed)):
        assert _core.reply_to_lookup(tree, packed[:end], "00") is None
    assert _core.reply_to_lookup(tree, packed + b"\0", "00") is None
    assert _core.reply_to_lookup(tree, packed, "0" * 256) is None
