"""What a request may cost a server: memory and work are bounded before they are spent.

The bounds are far above what is used, and far below what it was without them: gigabytes.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.server_costs import cost_of, fill_chain, fill_star, lookup
from tests.processes.servers import ServerProcess
from tests.support import messages
from tests.support.raw import Raw, raw
from zenoh_tf import wire
from zenoh_tf.errors import LimitExceeded, LookupException, ProtocolError, TransformException

pytestmark = [
    pytest.mark.own_server,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

#: Most that any request may take beyond its own reply.
MOST_MB = 150.0
DEPTH = 999


def error_of(reply: wire.Message) -> TransformException:
    return wire.decode_error(reply["error"])


def info(what: str, **arguments: object) -> wire.Message:
    return {"what": what, **arguments}


def batch_of(what: str, count: int) -> bytes:
    return wire.pack(wire.batch_body([("info", info(what))] * count))


def test_frames_of_a_large_tree(server: ServerProcess, wires: Raw) -> None:
    """A batch of many lists costs no more than one; a client gets them in pages."""
    frames = 250_000
    fill_star(wires, frames)
    with cost_of(server.process.pid) as cost:
        error = wires.error("info", {"v": 1, **info("frames")})
        replies = wires.query("batch", batch_of("frames", 1000), 30.0)["replies"]
    assert isinstance(error, LimitExceeded)
    assert (error.field, error.limit) == ("listed", 100_000)
    assert all(error_of(reply).field == "listed" for reply in replies)
    assert cost.peak_mb < MOST_MB
    with server.connect(30.0) as tf:
        names = tf.frames()
        assert len(names) == len(set(names)) == frames + 1
    # A page ends where the next begins, also after a removal.
    page = wires.query("info", {"v": 1, **info("frames", limit=10)})
    assert len(page["value"]) == 10
    wires.query("admin", {"v": 1, **info("remove_frame", name=page["value"][-1])})
    rest = wires.query("info", {"v": 1, **info("frames", limit=10, after=page["next"])})
    assert not set(page["value"]) & set(rest["value"])


def test_counts_of_a_large_tree_in_a_batch(server: ServerProcess, wires: Raw) -> None:
    fill_star(wires, 250_000)
    with cost_of(server.process.pid) as cost:
        for what in ("stats", "authorities"):
            replies = wires.query("batch", batch_of(what, 1000), 30.0)["replies"]
            assert "value" in replies[0]
            assert error_of(replies[1]).field == "listed"
    assert cost.peak_mb < MOST_MB
    assert cost.cpu_s < 5.0  # a scan for each takes a minute


def test_rows_times_depth(server: ServerProcess, wires: Raw) -> None:
    fill_chain(wires, DEPTH, "a")
    fill_chain(wires, DEPTH, "b")
    ends = (f"a{DEPTH}", f"b{DEPTH}")
    with cost_of(server.process.pid) as cost:
        for more in ({}, {"versions": True}, {"atomic": True}):
            error = wires.error("lookup", lookup(100_000, *ends) | more)
            assert isinstance(error, LimitExceeded)
            assert (error.field, error.limit) == ("links", 10_000_000)
        error = wires.error("lookup", lookup(2000, *ends, atomic=True))
        assert isinstance(error, LimitExceeded)
        assert (error.field, error.limit) == ("read_set", 1 << 19)
        split = wire.batch_body([("lookup", lookup(1000, *ends))] * 20)
        replies = wires.query("batch", split, 30.0)["replies"]
        read = wires.query("lookup", lookup(2000, *ends, versions=True), 30.0)
    assert [error_of(reply).field for reply in replies if "error" in reply] == ["links"] * 16
    # Each frame once, in whatever many rows.
    assert len(read["read_names"]) == len(set(read["read_names"])) >= 2 * DEPTH
    assert len(read["read_versions"]) == 8 * len(read["read_names"])
    assert cost.peak_mb < MOST_MB


def test_a_name_that_no_frame_can_have(server: ServerProcess, wires: Raw) -> None:
    name = "ä" * 500_000
    requests = {
        "lookup": lookup(3000, "map", name),
        "commit": messages.commit(["map", name], [0] * 1000, [1] * 1000),
        "info": {"v": 1, **info("frame", frame=name)},
        "admin": {"v": 1, **info("remove_frame", name=name)},
    }
    with cost_of(server.process.pid) as cost:
        for request_type, body in requests.items():
            error = wires.error(request_type, body)
            assert isinstance(error, LimitExceeded), request_type
            assert error.field in ("name_bytes", "max_name_bytes")
            assert error.value == 1_000_000
            assert len(str(error)) < 200
        body = wire.batch_body([("lookup", lookup(1000, "map", name))] * 5)
        for reply in wires.query("batch", body)["replies"]:
            assert isinstance(error_of(reply), LimitExceeded)
    assert cost.peak_mb < MOST_MB


def test_errors_of_many_failed_rows(server: ServerProcess, wires: Raw) -> None:
    rows = 10_000
    body = lookup(rows, "map", "")
    body["names"] = ["map", *(f"nowhere{row}" for row in range(rows))]
    body["source"] = np.arange(1, rows + 1, dtype=np.uint32).tobytes()
    with cost_of(server.process.pid) as cost:
        reply = wires.query("lookup", body, 30.0)
    assert reply["status"] == bytes([LookupException.code]) * rows
    assert 1000 < len(reply["errors"]) < 9000
    assert [row for row, _ in reply["errors"]] == list(range(len(reply["errors"])))
    assert reply["errors"][7][1]["facts"]["frame"] in ("map", "nowhere7")
    assert cost.peak_mb < MOST_MB
    # The same in a batch: the operations share the room for errors.
    one = wire.one_read("map", "nowhere", wire.OP_COMMON, wire.NO_STAMP)
    body = wire.batch_body([("lookup", one)] * 9000)
    replies = wires.query("batch", body, 30.0)["replies"]
    assert all(reply["status"] == bytes([LookupException.code]) for reply in replies)
    assert 1000 < sum(bool(reply["errors"]) for reply in replies) < 9000


def test_a_reply_has_a_limit(start_server: StartServer) -> None:
    server = start_server("--limit", "reply_bytes=10000")
    with raw(server.endpoint) as wires:
        fill_star(wires, 20)
        hello = wires.query("hello", {"v": 1, **info("hello")})
        assert hello["value"]["limits"]["reply_bytes"] == 10_000
        error = wires.error("lookup", lookup(200, "root", "frame1"))
        assert isinstance(error, LimitExceeded)
        assert (error.field, error.limit) == ("reply_bytes", 10_000)
        operations = [("lookup", lookup(30, "root", "frame1"))] * 8
        replies = wires.query("batch", wire.batch_body(operations))["replies"]
        assert len(replies[0]["status"]) == 30
        error = error_of(replies[-1])
        assert isinstance(error, LimitExceeded) and error.field == "reply_bytes"
        one = wire.one_read("root", "frame1", wire.OP_COMMON, wire.NO_STAMP)
        error = wires.error("batch", wire.batch_body([("lookup", one)] * 200))
        assert isinstance(error, LimitExceeded) and error.field == "reply_bytes"


def test_a_reply_that_no_client_accepts_cannot_be_allowed(start_server: StartServer) -> None:
    with pytest.raises(AssertionError, match="did not start"):
        start_server("--limit", f"reply_bytes={wire.MAX_REPLY_BYTES + 1}")


def hostile(size: int) -> Iterator[bytes]:
    """Messages of `size` bytes that take hundreds of times as much when they are decoded."""
    many = struct.pack(">I", min(size // 2, 1 << 20))
    yield (b"\xdd" + many) * 1000 + b"\0" * (size - 5000)  # lists that claim entries
    yield b"\x91" * size  # nested
    yield b"\x81\xa1v" * (size // 3)
    yield b"\x82\xa1v\x01\xaaoperations\xdd" + many + b"\x80" * size  # empty maps
    entries = size // 32 - 10
    one_list = b"\xdd" + struct.pack(">I", entries) + b"\x90" * entries
    yield b"\x82\xa1v\x01\xa1x\xdc\x00\x20" + one_list * 32  # 32 lists of empty lists
    yield b"\x82\xa1v\x01\xa5names\xdd" + many + b"\xa1x" * (size // 2)


@pytest.mark.parametrize(("size", "most_mb"), [(10_000, 30.0), (4_000_000, MOST_MB)])
def test_messages_that_are_dear_to_decode(
    server: ServerProcess, wires: Raw, size: int, most_mb: float
) -> None:
    for payload in hostile(size):
        for request_type in ("info", "batch", "lookup", "commit"):
            with cost_of(server.process.pid) as cost:
                error = wires.error(request_type, payload)
            assert isinstance(error, (ProtocolError, LimitExceeded)), payload[:20]
            assert len(str(error)) < 300
            assert cost.peak_mb < most_mb, payload[:20]


def test_more_operations_than_allowed(wires: Raw) -> None:
    body = wire.batch_body([("info", info("hello"))] * 25_001)
    error = wires.error("batch", body)
    assert isinstance(error, LimitExceeded)
    assert (error.field, error.limit, error.value) == ("operations", 25_000, 25_001)


def test_more_names_than_rows_can_use(wires: Raw) -> None:
    body = lookup(1, "a", "b") | {"names": ["x"] * 300_001}
    error = wires.error("lookup", body)
    assert isinstance(error, LimitExceeded) and error.field == "rows"
