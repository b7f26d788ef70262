"""Replicas as processes: one server executes each read, and clients read their own writes."""

from __future__ import annotations

import asyncio
import gc
import re
import threading
import time
import urllib.request
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import zenoh

from tests.conftest import StartServer, linux
from tests.processes.ports import free_endpoint, free_port
from tests.processes.replicas import DEADLINE_S, FRAMES, reads_near, seen, step
from tests.processes.servers import ServerProcess
from tests.support.raw import raw
from tests.support.threads import together
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf._net import zenoh_config
from zenoh_tf.errors import ReplicaBehind, ServerUnavailable, TransactionConflict
from zenoh_tf_client import AsyncTransformClient, Transaction, TransformClient
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.session.mapped_tree import Mode
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.sharing import SharingSettings
from zenoh_tf_server.process.upstream import Upstream
from zenoh_tf_server.replica.copies import SharedCopies
from zenoh_tf_server.replica.service import ReplicaService

READS = 30
REQUEST_TYPES = ("lookup", "batch", "info", "commit")
#: Health probes are lookups, too: one every 2 s.
PROBES = 8


# --- who executes


class Counted:
    """A server whose executed requests are counted."""

    def __init__(self, start: Callable[..., ServerProcess]) -> None:
        self._port = free_port()
        self.server = start("--metrics", f"127.0.0.1:{self._port}")

    def counts(self) -> dict[str, int]:
        """How many requests of each type it has executed, whatever came of them."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self._port}/metrics") as page:
            text = page.read().decode()
        pattern = r'^zenoh_tf_requests_total{outcome="\w+",request_type="(\w+)"} (\S+)$'
        found = dict.fromkeys(REQUEST_TYPES, 0)
        for request_type, count in re.findall(pattern, text, re.MULTILINE):
            found[request_type] = found.get(request_type, 0) + int(float(count))
        return found


def counts(servers: list[Counted]) -> list[dict[str, int]]:
    time.sleep(1.1)  # their pages are made once a second
    return [each.counts() for each in servers]


@pytest.mark.parametrize("shape", ["star", "chain", "triangle"])
def test_one_server_executes_each_read(
    shape: str, start_server: StartServer, start_replica: StartServer
) -> None:
    first = Counted(start_server)
    second = Counted(lambda *flags: start_replica(first.server, flags=flags))
    links = {"star": [first], "chain": [second], "triangle": [first, second]}[shape]
    third = Counted(lambda *flags: start_replica(*(each.server for each in links), flags=flags))
    servers = [first, second, third]
    with first.server.connect(10) as tf:
        tf.set_transforms_xact(step(1))
    after = counts(servers)
    for own in servers:
        before = after
        with own.server.connect(10) as tf, raw(own.server.endpoint) as wires:
            assert reads_near(tf) == (own is not first)
            tf.set_transforms_xact(step(tf.lookup_transform("map", FRAMES[0]).stamp_ns + 1))
            for _ in range(READS):
                tf.lookup_transform("map", FRAMES[0])
                with tf.batch() as batch:
                    batch.lookup_transform("map", FRAMES[1])
                tf.frames()
            lookup = wire.pack(wire.one_read("map", FRAMES[0], wire.OP_COMMON, wire.NO_STAMP))
            for _ in range(READS):  # as a client does that knows no replicas
                assert "error" not in wires.query("lookup", lookup)
            after = counts(servers)
        for index, each in enumerate(servers):
            executed = {
                request_type: after[index][request_type] - before[index][request_type]
                for request_type in REQUEST_TYPES
            }
            expected = READS if each is own else 0
            assert executed["batch"] == expected, (shape, index)
            assert executed["info"] == expected, (shape, index)
            assert executed["commit"] == (each is first), (shape, index)
            plain = READS if each is first else 0
            # One more lookup found the stamp; a replica may have refused it once or twice.
            assert expected + plain <= executed["lookup"] <= expected + plain + PROBES + 4


# --- reads and writes through a replica


def test_a_client_reads_its_own_writes(near: TransformClient) -> None:
    for stamp in range(1, 200):
        near.set_transforms_xact(step(stamp))
        assert seen(near) == stamp
        assert reads_near(near)
    assert near.replica_age_s is not None
    near.clear()
    assert near.frame(FRAMES[0]).samples == 0


@pytest.mark.parametrize("reads", ["query", "shared"])
def test_an_asynchronous_client_reads_its_own_writes(replica: ServerProcess, reads: Mode) -> None:
    async def write_and_read() -> None:
        async with await AsyncTransformClient.connect(replica.endpoint, reads=reads) as tf:
            for stamp in range(1, 50):
                await tf.set_transforms_xact(step(stamp))
                found = await asyncio.gather(
                    *(tf.lookup_latest_transform("map", name) for name in FRAMES)
                )
                assert {one.stamp_ns for one in found} == {stamp}
            assert tf.reads == ("query" if reads == "query" else "shared")

    asyncio.run(write_and_read())


def test_a_mirror_near_a_replica(near: TransformClient) -> None:
    with near.mirror() as m:
        near.set_transforms_xact(step(5))
        m.wait_for()
        assert m.lookup_transform("map", FRAMES[0]).stamp_ns == 5


def test_a_lookup_waits_at_the_replica(primary: ServerProcess, near: TransformClient) -> None:
    """A put reaches the primary, whose commit ends the wait in the replica."""
    near.set_transforms_xact(step(1))
    found: list[int] = []

    def look_up() -> None:
        found.append(near.lookup_transform("map", FRAMES[0], 5, timeout_s=20).stamp_ns)

    waiting = threading.Thread(target=look_up)
    waiting.start()
    wait_until(lambda: near.stats()["waiters"] == 1, "the lookup does not wait there")
    near.broadcaster("sensor").send([StampedTransform("map", FRAMES[0], 5, Transform())])
    waiting.join(DEADLINE_S)
    assert found == [5]
    with primary.connect(10) as tf:
        assert [each.name for each in tf.authorities() if each.name] == ["sensor"]


def test_transactions_of_clients_everywhere(primary: ServerProcess, replica: ServerProcess) -> None:
    """What was read in a replica is validated by the primary."""
    rounds = 25
    with primary.connect(20) as tf:
        tf.set_transform(StampedTransform("map", "count", 1, Transform()))

    def add(server: ServerProcess) -> None:
        with server.connect(20) as tf:
            for _ in range(rounds):
                tf.run_transaction(one_more, attempts=1000)

    def one_more(tx: Transaction) -> None:
        latest = tx.lookup_latest_transform_xact("map", "count")
        x = latest.transform.translation[0] + 1
        stamped = StampedTransform("map", "count", latest.stamp_ns + 1, Transform((x, 0, 0)))
        tx.set_transform(stamped)

    together(*(partial(add, each) for each in (primary, replica, replica)))
    with primary.connect(10) as tf:
        pose = tf.lookup_latest_transform("map", "count").transform
        assert pose.translation[0] == 3 * rounds


@pytest.mark.usefixtures("either_client")
@pytest.mark.parametrize("reads", ["query", "shared"])
def test_a_transaction_of_one_read_is_validated(
    primary: ServerProcess, replica: ServerProcess, reads: Mode
) -> None:
    """What a replica answers may be old, so also this one asks the primary."""
    with primary.connect(10) as far, replica.connect(10, reads=reads) as tf:
        tf.set_transforms_xact(step(1))
        assert seen(tf) == 1
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", FRAMES[0])
            far.set_transforms_xact(step(2))
        with tf.transaction() as tx:
            assert tx.lookup_latest_transform_xact("map", FRAMES[0]).stamp_ns == 2


def test_a_replica_that_lacks_a_write(primary: ServerProcess, near: TransformClient) -> None:
    """It refuses the read, and the client asks the primary."""
    near.set_transforms_xact(step(1))
    receipt = near.last_receipt
    assert receipt is not None
    near._connection.exchange.seen.least = Receipt(receipt.instance, receipt.seq + 1000)
    assert seen(near) == 1
    assert near.replica_age_s is None  # the primary's own reply
    assert near._connection.exchange.seen.least == receipt  # it knows best
    near._connection.exchange.seen.least = Receipt(receipt.instance, receipt.seq + 1000)
    primary.kill()
    with pytest.raises(ReplicaBehind, match=r"commit 1001 .* it has 1") as refusal:
        seen(near)
    assert (refusal.value.limit, refusal.value.value) == (receipt.seq + 1000, receipt.seq)


# --- clients on the replica's host


def reads_of(tf: TransformClient) -> str:
    """How a lookup would be answered now, which may change at any time."""
    return tf.reads


@linux
def test_a_client_on_the_host_reads_the_replicas_memory(
    primary: ServerProcess, start_replica: StartServer, socket_folder: Path
) -> None:
    replica = start_replica(primary, flags=("--share-dir", str(socket_folder)))
    with primary.connect(10) as far, replica.connect(10, reads="shared") as tf:
        assert reads_of(tf) == "shared"
        for stamp in range(1, 50):
            tf.set_transforms_xact(step(stamp))
            assert reads_of(tf) == "query"  # until the replica is known to have it
            assert seen(tf) == stamp
            assert reads_of(tf) == "shared"
            assert tf.lookup_transform("map", FRAMES[0]).stamp_ns == stamp
        asked = tf.stats()["reads_asked_absent"]
        far.set_transforms_xact(step(50))
        wait_until(lambda: seen(tf) == 50, "its memory does not change")
        assert tf.stats()["reads_asked_absent"] == asked
        # What was read in its memory is validated by the primary.
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", FRAMES[0])
            far.set_transforms_xact(step(51))
            tx.set_transform(step(99)[0])
        assert seen(tf) == 51
        primary.kill()
        assert seen(tf) == 51
        assert reads_of(tf) == "shared"
        replica.kill()
        wait_until(lambda: reads_of(tf) == "query", "it reads a dead replica's memory")
        with pytest.raises(ServerUnavailable):
            seen(tf)


@linux
def test_a_new_copy_has_memory_of_its_own(
    primary: ServerProcess,
    start_server: StartServer,
    start_replica: StartServer,
    socket_folder: Path,
) -> None:
    replica = start_replica(primary, flags=("--share-dir", str(socket_folder)))
    with replica.connect(10, reads="shared") as tf:
        tf.set_transforms_xact(step(7))
        assert seen(tf) == 7
        (old,) = socket_folder.glob("*.sock")
        primary.kill()
        start_server("--no-share", endpoint=primary.endpoint)
        wait_until(lambda: not old.exists(), "the old copy is still shared")

        def is_new() -> bool:
            tf.can_transform("map", "base")
            return reads_of(tf) == "shared" and tf.frames() == []

        wait_until(is_new, "the new copy is not read")
        tf.set_transforms_xact(step(1))
        assert seen(tf) == 1
    replica.stop()
    assert list(socket_folder.iterdir()) == []


def test_a_replaced_copy_goes_without_a_garbage_collection() -> None:
    """The server's collections are rare, and never have what was there when it started."""
    loop = asyncio.new_event_loop()
    copies = SharedCopies(SharingSettings(on=False), "main", "own")
    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        primary = Upstream(session, "main")  # which is not there
        replica = ReplicaService("main", "own", Limits(), loop, copies, primary)
        gc.disable()
        try:
            old = [TransformTree()]
            gone = weakref.ref(old[0])
            replica._take(old[0], "first")
            replica._take(TransformTree(), "second")
            old.clear()
            wait_until(lambda: gone() is None, "the first copy is still there")
        finally:
            gc.enable()
            replica.close()
            loop.close()
