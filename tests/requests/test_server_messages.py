"""Raw messages to a server: repeats, expiry, limits and garbage."""

from __future__ import annotations

import os
import struct
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.live_server import limited
from tests.processes.servers import ServerProcess
from tests.support import messages
from tests.support.raw import Raw, raw
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    ProtocolError,
    ServerBusy,
    ServerRestarted,
    TimeoutException,
    TransactionConflict,
)
from zenoh_tf_client import TransformClient


def commit(stamp_ns: int = 1, x: float = 0.0, child: str = "base", **more: Any) -> wire.Message:
    pose = struct.pack("<7d", x, 0, 0, 0, 0, 0, 1)
    return messages.commit(["map", child], [0], [1], stamp_ns, **{"pose": pose, **more})


def test_a_repeated_id_gets_the_first_outcome(wires: Raw, client: TransformClient) -> None:
    identity = os.urandom(16)
    first = wires.query("commit", commit(x=1.0, id=identity))
    assert first["stored"] == b"\1"
    assert wires.query("commit", commit(x=2.0, id=identity)) == first
    assert client.lookup_transform("map", "base").transform.translation[0] == 1.0
    # An error is remembered as well.
    identity = os.urandom(16)
    bad = wires.query("commit", commit(child="map", id=identity))
    assert wire.decode_error(bad["error"]).code == InvalidArgumentException.code
    assert wires.query("commit", commit(x=3.0, id=identity)) == bad
    # Without an id nothing is remembered.
    wires.query("commit", commit(x=4.0))
    wires.query("commit", commit(x=5.0))
    assert client.lookup_transform("map", "base").transform.translation[0] == 5.0


def test_replies_to_writes_tell_a_number(wires: Raw) -> None:
    """Each is above the one before. A conflict has the number of the commit that caused it."""
    numbers = []
    for stamp in (1, 2):
        numbers.append(wires.query("commit", commit(stamp, 1.0))["seq"])
    stale: dict[str, Any] = {"read_names": ["base"], "read_versions": struct.pack("<Q", 0)}
    conflict = wires.query("commit", commit(x=1.0, **stale))
    assert isinstance(wire.decode_error(conflict["error"]), TransactionConflict)
    numbers.append(conflict["seq"])
    operations = [["commit", commit(x=2.0)]]
    batch = wires.query("batch", {"v": 1, "operations": operations})
    numbers.append(batch["replies"][0]["seq"])
    body = {"v": 1, "what": "remove_frame", "name": "base"}
    numbers.append(wires.query("admin", body)["seq"])
    assert numbers == sorted(numbers)
    assert numbers[0] < numbers[1] <= numbers[2] < numbers[3] < numbers[4]
    assert "seq" not in wires.query("commit", commit(child="map"))  # refused


@pytest.mark.own_server
def test_repeats_of_a_running_write_share_its_outcome(wires: Raw, client: TransformClient) -> None:
    rows = 50_000
    identity = (0.0, 0, 0, 0, 0, 0, 1)
    links = TransformRows.of_tuples(("root", f"f{row}", row, identity) for row in range(rows))
    payload = wire.pack(wire.commit_body(wire.Commit(links)) | {"id": os.urandom(16)})
    with ThreadPoolExecutor(8) as pool:
        replies = list(pool.map(lambda _: wires.query("commit", payload), range(8)))
    assert all(reply == replies[0] and len(reply["stored"]) == rows for reply in replies)
    assert client.stats()["outcomes"] == 1


def test_batches_and_clear_run_once_too(wires: Raw, client: TransformClient) -> None:
    batch = wire.batch_body([("commit", commit(x=1.0))]) | {"id": os.urandom(16)}
    first = wires.query("batch", batch)
    assert wires.query("batch", batch) == first
    clear = wire.pack({**wire.call_body("clear"), "id": os.urandom(16)})
    wires.query("admin", clear)
    client.set_transform(StampedTransform("map", "base", 9, Transform()))
    wires.query("admin", clear)
    assert client.can_transform("map", "base")


def test_expiry_is_in_the_servers_clock(wires: Raw, client: TransformClient) -> None:
    clock_ns = wires.query("hello", wire.call_body("hello"))["value"]["clock_ns"]
    identity = os.urandom(16)
    late = wires.error("commit", commit(id=identity, expires_ns=clock_ns))
    assert isinstance(late, TimeoutException)
    assert late.field == "expires_ns"
    assert client.frames() == []
    soon = commit(id=identity, expires_ns=clock_ns + 500_000_000)
    assert wires.query("commit", soon)["stored"] == b"\1"
    far = wires.error("commit", commit(expires_ns=clock_ns + 700 * 10**9))
    assert isinstance(far, LimitExceeded)
    assert (far.field, far.limit) == ("expiry_s", 600)


def test_a_write_for_another_instance_is_refused(wires: Raw, client: TransformClient) -> None:
    error = wires.error("commit", commit(instance="0" * 16))
    assert isinstance(error, ServerRestarted)
    assert error.value == "0" * 16
    assert client.frames() == []


def test_outcomes_are_bounded_and_forgotten_after_expiry(start_server: StartServer) -> None:
    server = start_server("--limit", "outcomes=4")
    with raw(server.endpoint) as wires, server.connect() as tf:
        clock_ns = wires.query("hello", wire.call_body("hello"))["value"]["clock_ns"]
        until = clock_ns + 6_000_000_000
        for _ in range(2):
            wires.query("commit", commit(id=os.urandom(16), expires_ns=until))
        full = wires.error("commit", commit(id=os.urandom(16), expires_ns=until))
        assert isinstance(full, ServerBusy)
        assert (full.field, full.limit, full.value) == ("outcomes", 4, 3)
        assert full.retry_after_s is not None and 0 < full.retry_after_s < 7
        # Another client has a share of its own.
        assert tf.set_transform(StampedTransform("map", "base", 5, Transform()))
        wait_until(lambda: "error" not in wires.query("commit", commit(id=os.urandom(16))))


def test_limits_name_themselves(start_server: StartServer) -> None:
    server = start_server(
        "--limit", "rows=10", "--limit", "message_bytes=2000", "--limit", "frames=4",
    )  # fmt: skip
    with raw(server.endpoint) as wires, server.connect() as tf:
        link = StampedTransform("map", "base", 1, Transform())
        cases = {
            "rows": lambda: tf.sample("map", "base", np.arange(11)),
            "message_bytes": lambda: tf.lookup_transform("map", "x" * 3000),
        }
        for name, call in cases.items():
            with pytest.raises(LimitExceeded) as caught:
                call()
            assert caught.value.field == name, name
            assert caught.value.limit in (10, 2000)
        with tf.batch() as batch:
            half = batch.sample("map", "base", np.arange(6))
            rest = batch.sample("map", "base", np.arange(6))
        assert half.exception() is None
        error = rest.exception()
        assert isinstance(error, LimitExceeded) and error.field == "rows"
        big = wires.error("lookup", b"x" * 2001)
        assert isinstance(big, LimitExceeded) and big.field == "message_bytes"
        with pytest.raises(LimitExceeded):
            tf.set_transform(StampedTransform("map", "x" * 256, 1, Transform()))
        with pytest.raises(LimitExceeded):
            tf.set_transforms_xact(
                [StampedTransform("map", f"f{row}", 1, Transform()) for row in range(5)]
            )
        assert tf.frames() == []
        tf.set_transform(link)
        many = tf.broadcaster("many")
        many.send([link] * 11)
        _wait(tf, "bad_puts", 1)
        assert "the limit is 10 (--limit rows=N)" in server.log


def _wait(tf: TransformClient, counter: str, value: int) -> None:
    wait_until(lambda: tf.stats()[counter] >= value, tf.stats)


def test_calls_that_do_not_exist(wires: Raw) -> None:
    assert isinstance(wires.error("lookup", None), ProtocolError)
    for request_type, what in (("admin", "drop"), ("info", "gold"), ("info", "hello")):
        error = wires.error(request_type, wire.call_body(what))
        assert isinstance(error, InvalidArgumentException)
        assert error.field == "what"


@pytest.mark.own_server
def test_a_bad_put_names_authority_and_field(
    server: ServerProcess, wires: Raw, client: TransformClient
) -> None:
    wires.put("lidar/1", commit() | {"pose": b"short"})
    _wait(client, "bad_puts", 1)
    assert "put of 'lidar/1': ProtocolError: field 'pose' must be" in server.log
    wires.session.put("tf/v1/main/set/%2f", wire.pack(commit()))  # not the escape of '/'
    _wait(client, "bad_puts", 2)
    assert client.frames() == []


@pytest.mark.own_server
def test_refusals_are_counted_per_authority(wires: Raw, client: TransformClient) -> None:
    """In transforms, with the last reason, and also for authorities with nothing but refusals."""
    two_rows = {
        **commit(child="map"),
        "parent": struct.pack("<2I", 0, 0),
        "child": struct.pack("<2I", 1, 1),
        "stamp": struct.pack("<2q", 1, 2),
        "pose": struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1) * 2,
    }
    wires.put("good", commit())
    wires.put("mixed", two_rows)
    wires.put("mixed", commit(child="arm"))
    wires.put("mixed", two_rows)
    wires.put("mixed", b"garbage")
    wires.put("bad", two_rows, static=True)
    wires.put("", two_rows)
    wires.session.put("tf/v1/main/set/%2f", wire.pack(two_rows))  # not an escaped name
    _wait(client, "bad_puts", 6)
    records = {record.name: record for record in client.authorities()}
    assert set(records) == {"good", "mixed", "bad", ""}
    assert (records["good"].refused, records["good"].last_refusal) == (0, None)
    mixed, bad = records["mixed"], records["bad"]
    assert (mixed.commits, mixed.stored, mixed.refused) == (1, 1, 5)
    assert mixed.last_refusal is not None and mixed.last_refusal.startswith("ProtocolError: ")
    assert (bad.frames, bad.commits, bad.stored, bad.refused) == (0, 0, 0, 2)
    assert bad.last_refusal is not None and "own parent" in bad.last_refusal
    # A call that is refused raises, and is not counted.
    with pytest.raises(InvalidArgumentException):
        client.set_transform(StampedTransform("x", "x", 1, Transform()), authority="good")
    assert {record.name: record.refused for record in client.authorities()}["good"] == 0


def test_authorities_with_nothing_but_refusals_are_bounded() -> None:
    with (
        limited(refused_authorities=2) as server,
        raw(server.endpoint) as wires,
        server.connect() as tf,
    ):
        wires.put("good", commit())
        wires.put("good", b"garbage")
        for count, name in enumerate(("a", "b", "a", "c"), 2):
            wires.put(name, b"garbage")
            _wait(tf, "bad_puts", count)  # puts of two authorities may overtake each other
        refused = {record.name: record.refused for record in tf.authorities()}
        assert refused == {"good": 1, "a": 2, "c": 1}  # b was refused longest ago


def test_one_put_stores_its_good_rows_at_one_instant(wires: Raw, client: TransformClient) -> None:
    before = client.stats()  # counters of the server, which other tests have used
    two = {
        "v": 1,
        "names": ["map", "a", "b"],
        "parent": struct.pack("<2I", 0, 2),
        "child": struct.pack("<2I", 1, 2),  # b is its own parent
        "stamp": struct.pack("<2q", 1, 1),
        "pose": struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1) * 2,
    }
    wires.put("sensor", two)
    _wait(client, "puts", before["puts"] + 1)
    assert sorted(client.frames()) == ["a", "map"]
    wires.put("sensor", two | {"parent": struct.pack("<2I", 0, 1)})
    _wait(client, "puts", before["puts"] + 2)
    assert client.stats()["bad_puts"] == before["bad_puts"]
    assert sorted(client.frames()) == ["a", "b", "map"]
    assert client.frame("a").authority == "sensor"
