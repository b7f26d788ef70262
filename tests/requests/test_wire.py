"""The wire protocol: golden bytes, round trips, and malformed input."""

from __future__ import annotations

import pickle
import struct
import tracemalloc
from typing import Any

import msgpack
import numpy as np
import pytest

from zenoh_tf import _core, wire
from zenoh_tf.errors import (
    BY_CODE,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    ProtocolError,
    TimeoutException,
    TransformException,
)

LOOKUP = {
    "v": 1,
    "names": ["map", "base"],
    "op": b"\0",
    "target": struct.pack("<I", 0),
    "source": struct.pack("<I", 1),
    "stamp": struct.pack("<q", 7),
}
COMMIT = {
    "v": 1,
    "names": ["map", "base"],
    "parent": struct.pack("<I", 0),
    "child": struct.pack("<I", 1),
    "stamp": struct.pack("<q", 7),
    "pose": struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1),
}
REPLY = {
    "v": 1,
    "instance": "00",
    "status": b"\0\2",
    "stamp": struct.pack("<2q", 7, 0),
    "pose": struct.pack("<14d", *range(14)),
    "errors": [[1, {"code": 2, "message": "no frame x", "facts": {"frame": "x"}}]],
}


def test_columns_are_views_of_the_message() -> None:
    lookup = wire.parse_lookup(wire.unpack(wire.pack(LOOKUP)))
    assert not lookup.stamp.flags.owndata
    assert not lookup.stamp.flags.writeable


@pytest.mark.parametrize("code", BY_CODE)
def test_every_error_survives_with_its_facts(code: int) -> None:
    facts = {
        "target_frame": "map",
        "frame": "arm/ü",
        "stamp_ns": -(1 << 63),
        "newest_stamp_ns": (1 << 63) - 1,
        "limit": 3,
        "value": 2.5,
        "field": "pose",
    }
    error = BY_CODE[code]("why", **facts)
    again = wire.decode_error(msgpack.unpackb(msgpack.packb(wire.encode_error(error))))
    assert type(again) is type(error) is BY_CODE[code]
    assert (str(again), again.facts) == (str(error), facts)
    assert pickle.loads(pickle.dumps(again)).facts == facts


@pytest.mark.parametrize(
    ("kind", "base"), [(InvalidArgumentException, ValueError), (TimeoutException, TimeoutError)]
)
def test_errors_that_are_also_pythons_own(
    kind: type[TransformException], base: type[Exception]
) -> None:
    with pytest.raises(base, match="why") as caught:
        raise kind("why", field="stamp_ns")
    assert isinstance(caught.value, TransformException)
    assert caught.value.facts == {"field": "stamp_ns"}


def test_errors_of_a_newer_server_stay_understandable() -> None:
    again = wire.decode_error({"code": 99, "message": "new", "facts": {"frame": "x", "new": [1]}})
    assert type(again) is TransformException
    assert again.facts == {"frame": "x"}


def test_a_reply_names_its_rows() -> None:
    answer = wire.parse_lookup_reply(wire.unpack(wire.pack(REPLY)), 2)
    assert answer.pose.shape == (2, 7)
    (*row, pose, gap), (error, *_) = answer.rows()
    assert (*row, pose, gap) == (None, 7, 7, tuple(range(7)), 0)
    assert isinstance(error, LookupException)
    without = {**REPLY, "status": b"\0\x09", "errors": []}
    _, (error, *_) = wire.parse_lookup_reply(without, 2).rows()
    assert type(error) is ForwardExtrapolationException


def test_single_reads_and_answers_are_the_same_messages_as_many() -> None:
    plain = wire.one_read("map", "base", wire.OP_AT, 7)
    assert wire.parse_one_read(plain) == ("map", "base", wire.OP_AT, 7)
    assert wire.parse_one_read(wire.unpack(wire.pack(LOOKUP))) == ("map", "base", 0, 7)
    without_version = {name: value for name, value in plain.items() if name != "v"}
    assert wire.parse_one_read(without_version) == ("map", "base", wire.OP_AT, 7)  # in a batch
    for _, change, _ in MALFORMED[:29]:
        if "v" not in change:
            assert wire.parse_one_read({**LOOKUP, **change}) is None, change
    lookup = wire.parse_lookup(plain)
    pose: wire.Pose = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    for op, newest, gap in ((wire.OP_AT, None, 0), (wire.OP_LATEST, 9, 0), (wire.OP_AT, None, 8)):
        lookup.op = np.array([op], np.uint8)
        one = wire.one_answer(7, newest, pose, gap)
        many = wire.lookup_reply(
            lookup,
            np.zeros(1, np.uint8),
            np.array([7]),
            np.array([newest or 0]),
            np.array([pose]),
            gap=np.array([gap]) if gap else None,
        )
        assert wire.unpack(wire.pack(one | {"v": 1})) == wire.unpack(wire.pack(many | {"v": 1}))
        found = wire.parse_one_answer(one)  # the general form has the gap
        assert found == (None if gap else (7, newest or 7, pose))
        assert next(wire.parse_lookup_reply(one, 1).rows()) == (None, 7, newest or 7, pose, gap)
    for field, value in (("status", b"\2"), ("stamp", b""), ("pose", b"1"), ("newest", None)):
        assert wire.parse_one_answer(one | {field: value}) is None


def test_the_trees_operations_have_the_same_numbers() -> None:
    for name in (*(name for name in dir(_core) if name.startswith("OP_")), "NO_STAMP"):
        assert getattr(wire, name) == getattr(_core, name), name


MALFORMED: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    (LOOKUP, {"v": 2}, "v"),
    (LOOKUP, {"v": True}, "v"),
    (LOOKUP, {"v": None}, "v"),
    (LOOKUP, {"names": None}, "names"),
    (LOOKUP, {"names": "map"}, "names"),
    (LOOKUP, {"names": ["map", 1]}, "names"),
    (LOOKUP, {"names": ["map", b"base"]}, "names"),
    (LOOKUP, {"names": {}}, "names"),
    (LOOKUP, {"names": []}, "target"),
    (LOOKUP, {"names": ["map"]}, "source"),
    (LOOKUP, {"op": None}, "op"),
    (LOOKUP, {"op": [0]}, "op"),
    (LOOKUP, {"op": b"\x06"}, "op"),
    (LOOKUP, {"op": b"\xff"}, "op"),
    (LOOKUP, {"op": b"\0\0"}, "target"),
    (LOOKUP, {"op": b""}, "target"),
    (LOOKUP, {"op": b"\5"}, "fixed"),
    (LOOKUP, {"target": b"\0"}, "target"),
    (LOOKUP, {"target": "abcd"}, "target"),
    (LOOKUP, {"target": b"\2\0\0\0"}, "target"),
    (LOOKUP, {"source": b"\xff\xff\xff\xff"}, "source"),
    (LOOKUP, {"stamp": 7}, "stamp"),
    (LOOKUP, {"stamp": b"\0" * 16}, "stamp"),
    (LOOKUP, {"fixed": b"\0" * 4}, "source_stamp"),
    (LOOKUP, {"atomic": 1}, "atomic"),
    (LOOKUP, {"versions": None}, "versions"),
    (LOOKUP, {"timeout_ns": -1}, "timeout_ns"),
    (LOOKUP, {"timeout_ns": 1 << 63}, "timeout_ns"),
    (LOOKUP, {"timeout_ns": 1.0}, "timeout_ns"),
    (COMMIT, {"parent": b"\0" * 8}, "parent"),
    (COMMIT, {"child": b"\2\0\0\0"}, "child"),
    (COMMIT, {"stamp": None}, "stamp"),
    (COMMIT, {"stamp": b"\0" * 7}, "stamp"),
    (COMMIT, {"pose": b"\0" * 48}, "pose"),
    (COMMIT, {"pose": b"\0" * 112}, "pose"),
    (COMMIT, {"authority": 1}, "authority"),
    (COMMIT, {"static": "yes"}, "static"),
    (COMMIT, {"drop_old": 0}, "drop_old"),
    (COMMIT, {"read_names": ["a"]}, "read_versions"),
    (COMMIT, {"read_versions": b""}, "read_names"),
    (COMMIT, {"read_names": ["a"], "read_versions": b"\0" * 16}, "read_versions"),
    (COMMIT, {"id": b"short"}, "id"),
    (COMMIT, {"id": 16}, "id"),
    (COMMIT, {"expires_ns": "soon"}, "expires_ns"),
    (COMMIT, {"instance": 1}, "instance"),
    (REPLY, {"status": b"\0"}, "status"),
    (REPLY, {"pose": b""}, "pose"),
    (REPLY, {"newest": b""}, "newest"),
    (REPLY, {"errors": None}, "errors"),
    (REPLY, {"errors": [[2, {}]]}, "errors"),
    (REPLY, {"errors": [[-1, {}]]}, "errors"),
    (REPLY, {"errors": [[0]]}, "errors"),
    (REPLY, {"errors": [[0, 1]]}, "errors"),
    (REPLY, {"errors": [[0, {"code": 2, "message": 1, "facts": {}}]]}, "message"),
    (REPLY, {"errors": [[0, {"code": 2, "message": "", "facts": {"frame": []}}]]}, "facts"),
    ({"v": 1}, {"operations": None}, "operations"),
    ({"v": 1}, {"operations": [1]}, "operations[0]"),
    ({"v": 1}, {"operations": [["lookup", {}], ["admin", {}]]}, "operations[1]"),
    ({"v": 1}, {"operations": [["lookup", []]]}, "operations[0]"),
    ({"v": 1}, {"replies": []}, "replies"),
    ({"v": 1}, {"replies": [{}, 1]}, "replies"),
    ({"v": 1}, {"value": 1}, "value"),
]


@pytest.mark.parametrize(("message", "change", "field"), MALFORMED)
def test_malformed_messages_name_the_field(
    message: dict[str, Any], change: dict[str, Any], field: str
) -> None:
    with pytest.raises(ProtocolError) as caught:
        _parse(msgpack.packb({**message, **change}))
    assert caught.value.field == field


def _parse(payload: bytes) -> None:
    message = wire.unpack(payload)
    if "op" in message:
        wire.parse_lookup(message)
    elif "status" in message:
        wire.parse_lookup_reply(message, 2)
    elif "operations" in message:
        for _, body in wire.parse_batch(message):
            wire.parse_lookup(body)
    elif "replies" in message:
        wire.parse_batch_reply(message, 2)
    elif "value" in message:
        wire.parse_value(message, str)
    else:
        wire.parse_write(message)
        wire.parse_commit(message)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x90",
        b"\x81",
        b"\xdd\xff\xff\xff\xff",  # a list of 2**32 - 1
        b"\xdf\xff\xff\xff\xff",  # a map of as many
        b"\xc6\xff\xff\xff\xff",  # as many bytes
        b"\x91" * 100_000 + b"\xc0",  # deep nesting
        b"\x81\xa1v" * 2000 + b"\x01",
        b"\x82\xa1v\x01\xc0\x01",  # a key that is nil
        b"\x81\x01\x01",  # a key that is a number
        b"\x82\xa1v\x01\xa1x\xd4\x01\x00",  # an extension type
        b"\x81\xa1v\x01\x00",  # something behind the map
        msgpack.packb({**LOOKUP, **{f"k{i}": i for i in range(300)}}),
    ],
)
def test_payloads_that_are_no_message(payload: bytes) -> None:
    with pytest.raises(ProtocolError) as caught:
        wire.unpack(payload)
    assert caught.value.field == "message"


def test_text_that_is_not_utf8_is_named() -> None:
    payload = msgpack.packb(COMMIT).replace(b"base", b"\xff\xfe\xfd\xfc")
    with pytest.raises(ProtocolError) as caught:
        wire.unpack(payload)
    assert caught.value.field == "names[1]"


def test_a_message_over_the_limit_is_refused_unread() -> None:
    with pytest.raises(LimitExceeded) as caught:
        wire.unpack(b"x" * 11, max_bytes=10)
    assert (caught.value.field, caught.value.limit, caught.value.value) == ("message_bytes", 10, 11)


def test_a_long_message_is_copied_once() -> None:
    payload = wire.pack({"v": 1, "pose": bytes(4 << 20)})
    tracemalloc.start()
    try:
        message = wire.unpack(payload)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert message["pose"] == bytes(4 << 20)
    assert peak < 1.5 * len(payload)


@pytest.mark.parametrize("count", [1, 10_000])
def test_a_batch_in_steps_is_the_same_message(count: int) -> None:
    body = wire.batch_body([("lookup", LOOKUP), ("info", {"what": "stats"})] * count)
    payload = wire.pack(body | {"id": b"1" * 16})
    assert wire.unpack(payload, in_steps=True) == wire.unpack(payload)
    for damaged in (payload + b"\0", payload[:-1], payload.replace(b"\xa2id", b"\x02\xc0\xc0", 1)):
        with pytest.raises(ProtocolError):
            wire.unpack(damaged, in_steps=True)


def test_what_cannot_be_sent_is_the_callers_fault() -> None:
    for body in ({"v": 1, "names": ["\ud800"]}, {"v": 1, "n": 1 << 64}, {"v": 1, "n": object()}):
        with pytest.raises(InvalidArgumentException):
            wire.pack(body)
    assert wire.unpack(wire.pack({"v": 1, "x": 1})) == {"v": 1, "x": 1}  # the packer recovered
