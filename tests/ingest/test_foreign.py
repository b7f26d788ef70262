"""``--ingest``: transforms of dimos and Foxglove, as they put them on Zenoh."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import formats
from zenoh_tf._net import zenoh_config
from zenoh_tf_client import TransformClient

S = 10**9
#: map -> base_link at (1, 2, 3), 5.25 s, as the package dimos-lcm 0.1.6 encodes it.
DIMOS = bytes.fromhex(
    "c2b8a1c33a8923ec0000000100000000000000050ee6b280000000046d6170000000000a626173655f6c696e6b00"
    "3ff000000000000040000000000000004008000000000000"
    "0000000000000000000000000000000000000000000000003ff0000000000000"
)
KEY = "dimos/tf/tf2_msgs.TFMessage"


def protobuf(child: str, x: float) -> bytes:
    message = FrameTransforms()
    row = message.transforms.add()
    row.parent_frame_id, row.child_frame_id = "map", child
    row.timestamp.seconds = 7
    row.translation.x, row.rotation.w = x, 1.0
    return bytes(message.SerializeToString())


def as_json(child: str, x: float) -> bytes:
    row = {
        "timestamp": {"sec": 7, "nsec": 0},
        "parent_frame_id": "map",
        "child_frame_id": child,
        "translation": {"x": x, "y": 0, "z": 0},
        "rotation": {"x": 0, "y": 0, "z": 0, "w": 1},
    }
    return json.dumps({"transforms": [row]}).encode()


@pytest.fixture
def foreign(start_server: Callable[..., ServerProcess]) -> ServerProcess:
    return start_server(
        *("--ingest", "dimos/**=lcm", "--ingest", "fox/pb=foxglove"),
        *("--ingest", "fox/json/*=foxglove-json"),
    )


@pytest.fixture
def put(foreign: ServerProcess) -> Iterator[Callable[[str, bytes], None]]:
    with zenoh.open(zenoh_config.client([foreign.endpoint], 10.0)) as session:
        yield session.put


@pytest.fixture
def tf(foreign: ServerProcess) -> Iterator[TransformClient]:
    with foreign.connect() as tf:
        yield tf


def test_each_format_is_stored_under_its_key(put: Any, tf: TransformClient) -> None:
    put(KEY, DIMOS)
    put("fox/pb", protobuf("tool", 0.5))
    put("fox/json/arm", as_json("arm", 0.25))
    put("fox/other", as_json("other", 1))
    wait_until(lambda: {"base_link", "tool", "arm"} <= set(tf.frames()))
    base = tf.lookup_transform("map", "base_link", 5 * S + 250_000_000).transform
    assert base.translation.tolist() == [1, 2, 3]
    assert base.rotation.tolist() == [0, 0, 0, 1]
    assert tf.lookup_transform("map", "tool", 7 * S).transform.translation[0] == 0.5
    assert tf.lookup_transform("map", "arm", 7 * S).transform.translation[0] == 0.25
    assert [tf.frame(name).authority for name in ("base_link", "tool", "arm")] == [
        KEY,
        "fox/pb",
        "fox/json/arm",
    ]
    assert "other" not in tf.frames()


def test_bad_messages_are_counted_named_and_harm_nobody(put: Any, tf: TransformClient) -> None:
    before = tf.stats()["bad_puts"]
    nan = DIMOS[:-8] + struct.pack(">d", float("nan"))
    bad = [b"", DIMOS[:-1], DIMOS + b"\0", b"\xff" * 100, DIMOS[:8] + b"\x7f" * 40, nan]
    for payload in bad:
        put(KEY, payload)
    put("fox/pb", b"\xff\xff")
    put("fox/json/a", b'{"transforms": [{}]}')
    wait_until(lambda: tf.stats()["bad_puts"] == before + len(bad) + 2)
    reasons = {each.name: each.last_refusal for each in tf.authorities()}
    assert "fox/json/a" in reasons
    assert "cannot be decoded" in str(reasons["fox/pb"])
    put(KEY, DIMOS)
    wait_until(lambda: "base_link" in tf.frames())


@pytest.mark.parametrize("name", formats.NAMES)
def test_a_decoder_withstands_every_cut_and_flip(name: str) -> None:
    decode = formats.decoder_of(name)
    whole = {"lcm": DIMOS, "foxglove": protobuf("a", 1), "foxglove-json": as_json("a", 1)}
    data = whole.get(name, b"\x10\0\0\0" * 40)
    for at in range(len(data)):
        cut = decode([data[:at]])
        assert cut.malformed <= 1
        for bit in (1, 0x80):
            flipped = bytearray(data)
            flipped[at] ^= bit
            found = decode([bytes(flipped)])
            assert len(found.rows) == sum(found.counts)
