"""Remembered outcomes: what they hold, who may hold how many, and when a write runs."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.processes.live_server import limited
from tests.processes.server_costs import cost_of, lookup
from tests.processes.servers import ServerProcess
from tests.support import messages
from tests.support.raw import Raw, raw
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf.errors import ServerBusy, TimeoutException, TransformException
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.requests.service import Service
from zenoh_tf_server.state.file import Stored
from zenoh_tf_server.state.static_links import StaticLinks

READ = wire.one_read("map", "base", wire.OP_COMMON, wire.NO_STAMP)


def write(stamp_ns: int, **more: object) -> wire.Message:
    return messages.commit(["map", "base"], [0], [1], stamp_ns, **more)


def mixed(reads: int, stamp_ns: int, **more: object) -> bytes:
    """A batch of reads around a write."""
    operations = [("lookup", READ)] * reads
    operations[reads // 2 : reads // 2] = [("commit", write(stamp_ns))]
    return wire.pack(wire.batch_body(operations) | {"id": os.urandom(16), **more})


def clock_ns(wires: Raw) -> int:
    value: int = wires.query("hello", wire.call_body("hello"))["value"]["clock_ns"]
    return value


def error_of(reply: wire.Message) -> TransformException:
    return wire.decode_error(reply["error"])


@pytest.mark.own_server
def test_a_repeated_batch_reads_anew_and_writes_once(wires: Raw) -> None:
    payload = mixed(4, 5)
    first = wires.query("batch", payload)["replies"]
    assert [reply.get("stored") for reply in first] == [None, None, b"\1", None, None]
    assert first[0]["status"] != b"\0" and first[3]["status"] == b"\0"
    wires.query("commit", write(9))
    again = wires.query("batch", payload)["replies"]
    assert again[2] == first[2]
    newest = (9).to_bytes(8, "little")
    assert [again[index]["stamp"] for index in (0, 1, 3, 4)] == [newest] * 4
    counters = wires.query("info", wire.call_body("stats"))["value"]
    assert counters["commits"] == 2


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.own_server
def test_an_outcome_holds_the_writes_part_only(server: ServerProcess, wires: Raw) -> None:
    """Replies of 2 MB each, of which a few bytes are remembered."""
    with cost_of(server.process.pid) as cost:
        for stamp in range(40):
            big = ("lookup", lookup(25_000, "map", "base"))
            body = wire.batch_body([("commit", write(stamp)), big]) | {"id": os.urandom(16)}
            replies = wires.query("batch", body, 30.0)["replies"]
            assert replies[0]["stored"] == b"\1"
    assert cost.kept_mb < 60.0


def test_a_greedy_client_exhausts_only_its_own_share() -> None:
    with (
        limited(outcome_bytes=4000) as server,
        raw(server.endpoint) as wires,
        server.connect() as tf,
    ):
        until = clock_ns(wires) + 60_000_000_000

        def commit_until_refused() -> TransformException:
            for stamp in range(200):
                body = write(stamp, id=os.urandom(16), expires_ns=until)
                reply = wires.query("commit", body)
                if "error" in reply:
                    return error_of(reply)
            raise AssertionError("never refused")

        refused = commit_until_refused()
        assert isinstance(refused, ServerBusy)
        assert (refused.field, refused.limit) == ("outcome_bytes", 4000)
        assert refused.retry_after_s is not None and 0 < refused.retry_after_s < 61
        tf.clear()
        assert tf.stats()["outcomes"] > 2


def test_a_write_that_names_no_expiry_has_a_short_one() -> None:
    with limited(default_expiry_s=1) as server, raw(server.endpoint) as wires:
        wires.query("commit", write(1, id=os.urandom(16)))
        deadline = time.monotonic() + 20
        while True:
            wires.query("commit", write(2, id=os.urandom(16)))
            counters = wires.query("info", wire.call_body("stats"))["value"]
            if counters["outcomes"] == 1:  # the one that has just been made
                break
            assert time.monotonic() < deadline
            time.sleep(1.1)


@pytest.mark.parametrize("request_type", ["commit", "batch", "admin"])
def test_a_write_behind_a_stall_does_not_run_after_its_expiry(
    server: ServerProcess, wires: Raw, request_type: str
) -> None:
    """The server is frozen for longer than the write may wait. Its repeats do not run either."""
    wires.query("commit", write(1))
    more = {"id": os.urandom(16), "expires_ns": clock_ns(wires) + 300_000_000}
    payload = {
        "commit": wire.pack(write(2, **more)),
        "batch": wire.pack(wire.batch_body([("commit", write(2))]) | more),
        "admin": wire.pack(wire.call_body("reset") | more),
    }[request_type]
    with ThreadPoolExecutor(4) as pool:
        server.freeze()
        sent = [pool.submit(wires.query, request_type, payload, 20.0) for _ in range(4)]
        time.sleep(0.6)
        server.send_signal(signal.SIGCONT)
        replies = [future.result() for future in sent]
    replies.append(wires.query(request_type, payload))
    for reply in replies:
        error = error_of(reply)
        assert isinstance(error, TimeoutException)
        assert error.field == "expires_ns"
    found = wires.query("lookup", READ)
    assert found["stamp"] == (1).to_bytes(8, "little")


@pytest.mark.parametrize(
    "body",
    [
        wire.call_body("clear", keep_static=False),
        wire.call_body("reset"),
        wire.call_body("remove_frame", name="base"),
    ],
    ids=lambda body: str(body["what"]),
)
def test_an_admin_write_does_not_run_if_it_expires_while_it_waits(body: wire.Message) -> None:
    """It is in time when it begins, and another write of static links takes longer than that."""
    tree, limits = TransformTree(), Limits()
    tree.set_transform(StampedTransform("map", "base", 1, Transform()), static=True)
    links = StaticLinks(tree, limits, None, Stored())
    loop = asyncio.new_event_loop()
    service = Service(tree, "main", "i", limits, loop, links)
    replies: list[wire.Message] = []

    class Replies:
        client = "c"

        def __call__(self, reply: bytes, failed: bool) -> None:
            replies.append(wire.unpack(reply))

    def send(expires_ns: int) -> threading.Thread:
        payload = wire.pack(body | {"id": os.urandom(16), "expires_ns": expires_ns})
        thread = threading.Thread(target=service.handle, args=("admin", payload, Replies()))
        thread.start()
        return thread

    with links._lock:
        expires_ns = time.monotonic_ns() + 2_000_000_000
        thread = send(expires_ns)
        while not service.stats()["outcomes"]:  # it has begun
            assert time.monotonic_ns() < expires_ns
        while time.monotonic_ns() <= expires_ns:
            time.sleep(0.01)
    thread.join()
    error = error_of(replies.pop())
    assert isinstance(error, TimeoutException)
    assert (error.field, error.limit) == ("expires_ns", expires_ns)
    assert tree.can_transform("map", "base")
    send(time.monotonic_ns() + 60_000_000_000).join()
    assert replies.pop()["value"] is None
    assert not tree.can_transform("map", "base")
    service.close()
    loop.close()


def test_an_id_of_a_write_of_another_kind_is_refused(wires: Raw) -> None:
    used = os.urandom(16)
    assert wires.query("commit", write(5, id=used))["stored"] == b"\1"
    reply = wires.query("batch", mixed(2, 6, id=used))
    assert "the id is that of another write" in str(error_of(reply))
    assert error_of(reply).field == "id"
    one, two = os.urandom(16), [("commit", write(7)), ("commit", write(8))]
    assert "replies" in wires.query("batch", mixed(1, 6, id=one))
    more = wires.query("batch", wire.batch_body(two) | {"id": one})
    assert "a batch with 1 transactions" in str(error_of(more))
