"""Replicas as processes: servers that answer everything but writes, from a copy of a tree."""

from __future__ import annotations

import asyncio
import gc
import re
import threading
import time
import urllib.request
import weakref
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from tests.conftest import StartServer, linux
from tests.processes.ports import free_endpoint, free_port
from tests.processes.replicas import DEADLINE_S, FRAMES, seen, step, wait_for_writes
from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf._net import zenoh_config
from zenoh_tf.errors import (
    ReadOnlyReplica,
    ServerBusy,
    ServerUnavailable,
    TransactionConflict,
    TransformException,
)
from zenoh_tf_client import AsyncTransformClient, Mirror, TransformClient
from zenoh_tf_client.requests.info import frames
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.requests.request import Call
from zenoh_tf_client.session.mapped_tree import Mode
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.sharing import SharingSettings
from zenoh_tf_server.process.upstream import Upstream
from zenoh_tf_server.replica.copies import SharedCopies
from zenoh_tf_server.replica.service import ReplicaService
from zenoh_tf_server.requests.guard import RequestGuard

LINK = StampedTransform("map", "base", 1, Transform())


def frames_with(receipt: Receipt) -> Call[list[str]]:
    """A question that must see a commit."""
    body = frames().body() | wire.floor_field(*receipt)
    return Call("info", body, lambda reply: wire.parse_value(reply, list))


# --- reads


def executed(port: int, request_type: str) -> int:
    """How many requests of a type a server has executed, whatever came of them."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as page:
        text = page.read().decode()
    pattern = rf'^zenoh_tf_requests_total{{outcome="\w+",request_type="{request_type}"}} (\S+)$'
    return sum(int(float(count)) for count in re.findall(pattern, text, re.MULTILINE))


def test_replicas_of_replicas_answer_by_themselves(
    start_server: StartServer, start_replica: StartServer
) -> None:
    port = free_port()
    first = start_server("--metrics", f"127.0.0.1:{port}")
    second = start_replica(first)
    third = start_replica(second)
    with first.connect(10) as tf, second.connect(10) as near, third.connect(10) as far:
        tf.set_transforms_xact(step(3))
        for reader in (near, far):
            wait_for_writes(tf, reader)
        time.sleep(1.1)  # its page is made once a second
        before = executed(port, "batch")
        for reader in (near, far):
            assert seen(reader) == 3 and reader.age_s is not None and reader.age_s < 20
            with reader.batch() as batch:
                found = batch.lookup_transform("map", FRAMES[0])
            assert found.result().stamp_ns == 3
            assert reader.instance == tf.instance
        assert tf.age_s is None
        time.sleep(1.1)
        assert executed(port, "batch") == before
        first.kill()
        assert (seen(near), seen(far)) == (3, 3)


@pytest.mark.parametrize("reads", ["query", "shared"])
def test_an_asynchronous_client_reads_a_replica(
    primary: ServerProcess, replica: ServerProcess, reads: Mode
) -> None:
    async def read() -> None:
        async with await AsyncTransformClient.connect(replica.endpoint, reads=reads) as tf:
            found = await asyncio.gather(
                *(tf.lookup_latest_transform("map", name) for name in FRAMES)
            )
            assert {one.stamp_ns for one in found} == {4}
            with pytest.raises(ReadOnlyReplica):
                await asyncio.gather(*(tf.set_transform(LINK) for _ in range(3)))

    with primary.connect(10) as tf, replica.connect(10) as near:
        tf.set_transforms_xact(step(4))
        wait_for_writes(tf, near)
    asyncio.run(read())


def test_a_lookup_waits_at_the_replica(primary: ServerProcess, near: TransformClient) -> None:
    found: list[int] = []

    def look_up() -> None:
        found.append(near.lookup_transform("map", FRAMES[0], 5, timeout_s=20).stamp_ns)

    with primary.connect(10) as tf:
        tf.set_transforms_xact(step(1))
        waiting = threading.Thread(target=look_up)
        waiting.start()
        wait_until(lambda: near.stats()["waiters"] == 1, "the lookup does not wait there")
        tf.broadcaster("sensor").send([StampedTransform("map", FRAMES[0], 5, Transform())])
        waiting.join(DEADLINE_S)
        assert found == [5]
        assert [each.name for each in near.authorities() if each.name] == ["sensor"]


def test_mirrors_follow_a_replica(
    primary: ServerProcess, replica: ServerProcess, start_server: StartServer
) -> None:
    """Also those of some pairs, and one that is opened when the primary is gone."""
    with primary.connect(10) as tf, replica.connect(10) as near:
        tf.set_transforms_xact(step(1))
        wait_for_writes(tf, near)
        with near.mirror() as whole, near.mirror([("map", FRAMES[0])]) as pair:
            for stamp in range(2, 300):
                tf.set_transforms_xact(step(stamp))
            for each in (whole, pair):
                each.wait_for(tf.last_receipt, DEADLINE_S)
                found = each.sample("map", FRAMES[0], range(1, 300))
                assert not found.status.any()
                assert found.translations[:, 0].tolist() == list(range(1, 300))
            wait_until(lambda: whole.age_s < 1 and pair.age_s < 1, "they are old")
            primary.kill()
            with near.mirror() as late:
                assert late.lookup_transform("map", FRAMES[1]).stamp_ns == 299
            wait_until(lambda: whole.age_s > 1 and pair.age_s > 1, "they do not age")
            start_server(endpoint=primary.endpoint)
            wait_until(lambda: near.instance != tf.last_receipt.instance, "no new server")  # type: ignore[union-attr]
            with primary.connect(10) as new:
                new.set_transforms_xact(step(1))
                whole.wait_for(new.last_receipt, DEADLINE_S)
                wait_until(lambda: _has(pair, 1), "the pair does not follow the new server")


def _has(mirror: Mirror, stamp: int) -> bool:
    try:
        return mirror.lookup_transform("map", FRAMES[0]).stamp_ns == stamp
    except TransformException:
        return False


# --- writes


def test_nobody_can_write_to_a_replica(primary: ServerProcess, near: TransformClient) -> None:
    def in_batch() -> None:
        with near.batch() as batch:
            batch.lookup_transform("map", FRAMES[0])
            batch.set_transform(LINK)

    def in_transaction() -> None:
        with near.transaction() as tx:
            tx.lookup_latest_transform_xact("map", FRAMES[0])
            tx.set_transform(LINK)

    with primary.connect(10) as tf:
        tf.set_transforms_xact(step(1))
        wait_for_writes(tf, near)
        before = tf.last_receipt
        for write in (
            lambda: near.set_transform(LINK),
            lambda: near.set_transform(LINK, static=True),
            in_batch,
            in_transaction,
            near.clear,
            near.reset,
            lambda: near.remove_frame(FRAMES[0]),
            lambda: near.broadcaster("sensor"),
        ):
            with pytest.raises(ReadOnlyReplica) as refusal:
                write()
            assert refusal.value.value == primary.endpoint
            assert primary.endpoint in str(refusal.value)
        assert sorted(tf.frames()) == sorted(near.frames()) == sorted(["map", *FRAMES])
        assert near.last_receipt in (None, before)


@pytest.mark.usefixtures("either_client")
@pytest.mark.parametrize("reads", ["query", "shared"])
def test_a_transaction_that_only_reads(
    primary: ServerProcess, replica: ServerProcess, reads: Mode
) -> None:
    """It is compared with the copy: so what it has read is one state."""
    with primary.connect(10) as far, replica.connect(10, reads=reads) as tf:
        far.set_transforms_xact(step(1))
        wait_for_writes(far, tf)
        with pytest.raises(TransactionConflict), tf.transaction() as tx:
            tx.lookup_latest_transform_xact("map", FRAMES[0])
            far.set_transforms_xact(step(2))
            wait_for_writes(far, tf)
            tx.lookup_latest_transform_xact("map", FRAMES[1])
        with tf.transaction() as tx:
            for name in FRAMES:
                assert tx.lookup_latest_transform_xact("map", name).stamp_ns == 2


# --- what a client has seen


def test_a_replica_that_is_behind_is_busy(
    primary: ServerProcess, start_replica: StartServer, start_server: StartServer
) -> None:
    with TcpProxy(primary.endpoint) as proxy:
        replica = start_server("--replica-of", proxy.endpoint)
        with primary.connect(10) as tf, replica.connect(0.5) as near:
            tf.set_transforms_xact(step(1))
            assert tf.last_receipt is not None
            assert near._connection.call(frames_with(tf.last_receipt))
            proxy.hold()
            tf.set_transforms_xact(step(2))
            lacking = tf.last_receipt
            with pytest.raises(ServerBusy, match="has not received commit") as refusal:
                near._connection.call(frames_with(lacking))
            assert (refusal.value.limit, refusal.value.value) == (lacking.seq, lacking.seq - 1)
            unknown = Receipt("an instance of the future or of the past", 1)
            with pytest.raises(ServerBusy):
                near._connection.call(frames_with(unknown))
            assert near.frames()  # for all others it answers
            proxy.release()
            for receipt in (lacking, unknown):  # the primary is another one: that one is gone
                wait_until(lambda receipt=receipt: _answers(near, receipt), "it does not answer")  # type: ignore[misc]


def _answers(tf: TransformClient, receipt: Receipt) -> bool:
    try:
        return bool(tf._connection.call(frames_with(receipt)))
    except TransformException:
        return False


# --- clients on the replica's host


@linux
def test_a_client_on_the_host_reads_the_replicas_memory(
    primary: ServerProcess, start_replica: StartServer, socket_folder: Path
) -> None:
    replica = start_replica(primary, flags=("--share-dir", str(socket_folder)))
    with primary.connect(10) as far, replica.connect(10, reads="shared") as tf:
        assert tf.reads == "shared"
        far.set_transforms_xact(step(50))
        wait_for_writes(far, tf)
        asked = tf.stats()["reads_asked_absent"]
        assert seen(tf) == 50
        assert tf.stats()["reads_asked_absent"] == asked
        primary.kill()
        assert seen(tf) == 50
        replica.kill()
        wait_until(lambda: tf.reads == "query", "it reads a dead replica's memory")
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
        with primary.connect(10) as far:
            far.set_transforms_xact(step(7))
            wait_for_writes(far, tf)
        assert seen(tf) == 7
        (old,) = socket_folder.glob("*.sock")
        primary.kill()
        start_server("--no-share", endpoint=primary.endpoint)
        wait_until(lambda: not old.exists(), "the old copy is still shared")

        def is_new() -> bool:
            tf.can_transform("map", "base")
            return tf.reads == "shared" and tf.frames() == []

        wait_until(is_new, "the new copy is not read")
        with primary.connect(10) as far:
            far.set_transforms_xact(step(1))
            wait_for_writes(far, tf)
        assert seen(tf) == 1
    replica.stop()
    assert list(socket_folder.iterdir()) == []


def test_a_replaced_copy_goes_without_a_garbage_collection() -> None:
    """The server's collections are rare, and never have what was there when it started."""
    loop = asyncio.new_event_loop()
    copies = SharedCopies(SharingSettings(off=True), "main")
    settings = wire.TreeSettings(10**10, 100, 100, 255, 64)
    served: list[str] = []
    with zenoh.open(zenoh_config.router([free_endpoint()])) as session:
        primary = Upstream(session, "main")  # which is not there
        guard, limits = RequestGuard(), Limits()
        replica = ReplicaService(
            *("main", "tcp/p:1", limits, loop, copies, primary, session, guard, served.append),
            is_connected=lambda client: True,
        )
        gc.disable()
        try:
            old = [replica._make_tree(settings, "first")]
            gone: Callable[[], TransformTree | None] = weakref.ref(old[0])
            replica._take(old[0], "first")
            replica._take(replica._make_tree(settings, "second"), "second")
            old.clear()
            wait_until(lambda: gone() is None, "the first copy is still there")
        finally:
            gc.enable()
            replica.close()
            loop.close()
    assert served == ["first", "second"]
