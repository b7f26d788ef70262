"""Clients with several endpoints, whose server or router is lost.

No read is wrong, none is older than what its client has read before, and none fails.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest

from tests.conftest import StartServer
from tests.processes.replicas import FRAMES, seen, step
from tests.processes.router_process import RouterProcess
from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.waiting import wait_until
from zenoh_tf import LatestTransform, StampedTransform, Transform
from zenoh_tf.errors import (
    OutcomeUnknown,
    ReadOnlyReplica,
    ServerUnavailable,
    TransactionConflict,
    TransformException,
)
from zenoh_tf_client import AsyncTransaction, AsyncTransformClient, Transaction, TransformClient

#: Reads that each reader makes between two steps of a test.
READS = 20
#: Of each read: above the lease of servers, and below that of Zenoh, which would be too long.
TIMEOUT_S = 9.0


class Readers:
    """A synchronous and an asynchronous client, and a mirror, which read all the time."""

    def __init__(self, endpoints: Sequence[str]) -> None:
        self._endpoints = list(endpoints)
        self._ending = threading.Event()
        self.faults: list[str] = []
        #: By reader: the last step that it has seen, and how often it has read.
        self.last: dict[str, int] = {}
        self.counts: dict[str, int] = {}
        self._threads = [
            threading.Thread(target=self._watched, args=(name, read))
            for name, read in (
                ("client", self._read),
                ("mirror", self._read_mirror),
                ("asyncio", lambda: asyncio.run(self._read_async())),
            )
        ]
        #: By reader: the client, once it has connected.
        self.clients: dict[str, TransformClient | AsyncTransformClient] = {}
        for thread in self._threads:
            thread.start()
        self.go_on()

    def close(self) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join()

    def go_on(self) -> None:
        """Wait until every reader has read some more."""
        before = dict(self.counts)
        wait_until(
            lambda: (
                self.faults
                or (
                    len(self.counts) == len(self._threads)
                    and all(
                        count >= before.get(name, 0) + READS for name, count in self.counts.items()
                    )
                )
            ),
            lambda: f"somebody does not read: {self.counts}",
        )
        assert self.faults == [], self.faults

    def are_at(self, endpoint: str) -> bool:
        """Whether all are connected to this endpoint."""
        return {tf.endpoint for tf in self.clients.values()} == {endpoint}

    def have(self, stamp: int) -> bool:
        """Whether all have seen a step."""
        return all(last >= stamp for last in self.last.values())

    def _watched(self, name: str, read: Callable[[], None]) -> None:
        try:
            read()
        except (TransformException, AssertionError) as error:
            self.faults.append(f"{name}: {type(error).__name__}: {error}")

    def _record(self, name: str, stamp: int) -> None:
        if stamp < self.last.get(name, 0):
            self.faults.append(f"{name}: {stamp} after {self.last[name]}")
        self.last[name] = stamp
        self.counts[name] = self.counts.get(name, 0) + 1

    def _read(self) -> None:
        with TransformClient.connect(self._endpoints, timeout_s=TIMEOUT_S) as tf:
            self.clients["client"] = tf
            while not self._ending.is_set():
                self._record("client", seen(tf))

    def _read_mirror(self) -> None:
        with TransformClient.connect(self._endpoints, timeout_s=TIMEOUT_S) as tf, tf.mirror() as m:
            self.clients["mirror"] = tf
            while not self._ending.wait(0.005):
                self._record("mirror", seen(m))  # type: ignore[arg-type]

    async def _read_async(self) -> None:
        pairs = [("map", name) for name in FRAMES]
        async with await AsyncTransformClient.connect(self._endpoints, timeout_s=TIMEOUT_S) as tf:
            self.clients["asyncio"] = tf
            while not self._ending.is_set():
                found = await tf.lookup_latest_transforms_xact(pairs)
                (stamp,) = {one.stamp_ns for one in found}
                self._record("asyncio", stamp)


@contextmanager
def readers(*endpoints: str) -> Iterator[Readers]:
    reading = Readers(endpoints)
    try:
        yield reading
    finally:
        reading.close()


@contextmanager
def writer(server: ServerProcess) -> Iterator[list[int]]:
    """Writes a step after the other to a server; the last one's stamp."""
    ending = threading.Event()
    last = [1]

    def write() -> None:
        with server.connect(20) as tf:
            while not ending.wait(0.002):
                with contextlib.suppress(OutcomeUnknown, ServerUnavailable):  # it is stopped
                    tf.set_transforms_xact(step(last[0] + 1))
                last[0] += 1

    with server.connect(20) as tf:
        tf.set_transforms_xact(step(1))
    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield last
    finally:
        ending.set()
        thread.join()


def is_fresh(reading: Readers, last: list[int]) -> None:
    """All see what is written from now on."""
    now = last[0] + 1
    wait_until(lambda: last[0] >= now and reading.have(now), lambda: (reading.last, now))
    reading.go_on()


# --- reads


def move(reading: Readers, endpoint: str, lose: Callable[[], object]) -> None:
    """Lose the server, and see that all readers continue at an endpoint."""
    lose()
    wait_until(lambda: reading.are_at(endpoint), "somebody has not moved")
    reading.go_on()


@pytest.mark.parametrize("how", ["killed", "stopped", "cut off"])
def test_reads_continue_at_the_next_endpoint(
    how: str, primary: ServerProcess, start_replica: StartServer
) -> None:
    near, far = start_replica(primary), start_replica(primary)
    with TcpProxy(near.endpoint) as proxy, writer(primary) as last:
        where = proxy.endpoint if how == "cut off" else near.endpoint
        with readers(where, far.endpoint) as reading:
            assert reading.are_at(where)
            lose = {"killed": near.kill, "stopped": near.freeze, "cut off": proxy.hold}[how]
            move(reading, far.endpoint, lose)
            is_fresh(reading, last)
            # They stay there, and continue at the first one again once this one is gone.
            if how == "killed":
                near = start_replica(primary, endpoint=near.endpoint)
            near.send_signal(signal.SIGCONT)
            proxy.release()
            reading.go_on()
            assert reading.are_at(far.endpoint)
            move(reading, where, far.kill)
            is_fresh(reading, last)


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_a_router_that_lives_has_lost_its_server(
    how: str, primary: ServerProcess, start_replica: StartServer
) -> None:
    replica, router = start_replica(primary), RouterProcess(primary.endpoint)
    try:
        with primary.connect(20) as tf:
            tf.set_transforms_xact(step(7))
        with readers(router.endpoint, replica.endpoint) as reading:
            assert reading.are_at(router.endpoint)
            move(reading, replica.endpoint, primary.kill if how == "killed" else primary.freeze)
            assert set(reading.last.values()) == {7}
    finally:
        router.kill()


@pytest.mark.slow
def test_reads_continue_when_a_router_is_lost(primary: ServerProcess) -> None:
    """The clients reach the primary through either of two routers."""
    near, far = RouterProcess(primary.endpoint), RouterProcess(primary.endpoint)
    try:
        with writer(primary) as last, readers(near.endpoint, far.endpoint) as reading:
            move(reading, far.endpoint, near.freeze)
            is_fresh(reading, last)
            near.go_on()
            move(reading, near.endpoint, far.kill)
            is_fresh(reading, last)
    finally:
        near.kill()
        far.kill()


@pytest.mark.slow
def test_a_new_primary_has_another_tree(
    primary: ServerProcess, start_server: StartServer, start_replica: StartServer
) -> None:
    """Every reader has it, at the replica as well."""
    replica = start_replica(primary)
    with primary.connect(20) as tf:
        tf.set_transforms_xact(step(7))
    with readers(primary.endpoint, replica.endpoint) as reading:
        move(reading, replica.endpoint, primary.kill)
        assert set(reading.last.values()) == {7}
    with TransformClient.connect([primary.endpoint, replica.endpoint], timeout_s=20) as tf:
        assert (seen(tf), tf.endpoint) == (7, replica.endpoint)
        primary = start_server(endpoint=primary.endpoint)
        with primary.connect(20) as writing:
            writing.set_transforms_xact(step(8))
        wait_until(lambda: tf.frames() and seen(tf) == 8, "it does not see the new tree")
        assert tf.endpoint == replica.endpoint
        replica.kill()
        assert seen(tf) == 8
        tf.set_transforms_xact(step(9))
        assert (seen(tf), tf.endpoint) == (9, primary.endpoint)


def test_a_client_sees_its_writes_wherever_it_goes(
    primary: ServerProcess, start_replica: StartServer
) -> None:
    with TcpProxy(primary.endpoint) as upstream, TcpProxy(primary.endpoint) as own:
        behind = start_replica(flags=("--replica-of", upstream.endpoint))
        endpoints = [own.endpoint, behind.endpoint]
        with TransformClient.connect(endpoints, timeout_s=20) as tf, tf.mirror() as m:
            tf.set_transforms_xact(step(1))
            wait_until(lambda: is_there(behind, 1), "the replica has nothing")
            upstream.hold()
            tf.set_transforms_xact(step(2))
            m.wait_for(tf.last_receipt)
            own.reset()
            wait_until(lambda: tf.endpoint == behind.endpoint, "it does not move")
            assert seen(m) == 2  # type: ignore[arg-type]
            threading.Timer(0.5, upstream.release).start()
            assert seen(tf) == 2
            assert seen(m) == 2  # type: ignore[arg-type]


def is_there(server: ServerProcess, stamp: int) -> bool:
    with server.connect(10) as tf:
        return bool(tf.frames()) and seen(tf) == stamp


def test_nobody_is_left(start_server: StartServer) -> None:
    both = [start_server(), start_server(tree="other")]
    with TransformClient.connect([each.endpoint for each in both], timeout_s=1) as tf:
        assert tf.frames() == []
        for each in both:
            each.kill()
        for call in (tf.frames, lambda: tf.set_transform(step(1)[0])):
            with pytest.raises((ServerUnavailable, OutcomeUnknown)) as refusal:
                call()
            assert all(each.endpoint in str(refusal.value) for each in both)
        start_server(endpoint=both[0].endpoint)
        wait_until(lambda: answers(tf), "it does not connect again")


def answers(tf: TransformClient) -> bool:
    try:
        return tf.frames() == []
    except ServerUnavailable:
        return False


# --- writes


def test_what_is_published_moves_with_the_client(
    primary: ServerProcess, start_replica: StartServer
) -> None:
    """Through another router, and not to a replica."""
    near, far = RouterProcess(primary.endpoint), RouterProcess(primary.endpoint)
    replica = start_replica(primary)
    endpoints = [near.endpoint, far.endpoint, replica.endpoint]
    try:
        with primary.connect(20) as tf, TransformClient.connect(endpoints, timeout_s=20) as own:
            sensor = own.broadcaster("sensor")
            sensor.send_static([StampedTransform("base", "mount", 0, Transform())])
            sensor.send([StampedTransform("map", "base", 1, Transform())])
            wait_until(lambda: tf.can_transform("map", "mount"), "nothing arrives")
            near.kill()
            wait_until(lambda: own.endpoint == far.endpoint, "it does not move")

            def has_arrived() -> bool:
                sensor.send([StampedTransform("map", "base", 2, Transform())])
                return tf.can_transform("map", "base", 2)

            wait_until(has_arrived, "nothing arrives any more")
            far.kill()
            wait_until(lambda: own.endpoint == replica.endpoint, "it does not move")
            for send in (sensor.send, sensor.send_static):
                with pytest.raises(ReadOnlyReplica):
                    send([StampedTransform("map", "base", 3, Transform())])
    finally:
        near.kill()
        far.kill()


def one_more(latest: LatestTransform) -> StampedTransform:
    x = latest.transform.translation[0] + 1
    return StampedTransform("map", "count", latest.stamp_ns + 1, Transform((x, 0, 0)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["synchronous", "asynchronous"])
def test_no_write_is_lost_or_doubled_whatever_becomes_of_the_link(
    kind: str, primary: ServerProcess
) -> None:
    """The link is lost again and again. Each write is there once, or its outcome is not known."""
    moves = 300
    outcomes: Counter[type[Exception] | None] = Counter()

    def count(error: Exception | None) -> None:
        # Only a write whose outcome is not known yet may come between a read and its commit.
        assert not isinstance(error, TransactionConflict) or outcomes[OutcomeUnknown]
        outcomes[None if error is None else type(error)] += 1

    with primary.connect(20) as tf:
        tf.set_transform(StampedTransform("map", "count", 1, Transform()))

    def add(tx: Transaction) -> None:
        tx.set_transform(one_more(tx.lookup_latest_transform_xact("map", "count")))

    async def add_async(tx: AsyncTransaction) -> None:
        tx.set_transform(one_more(await tx.lookup_latest_transform_xact("map", "count")))

    def write() -> None:
        with TransformClient.connect(endpoints, timeout_s=20) as tf:
            for _ in range(moves):
                try:
                    tf.run_transaction(add, attempts=1)
                    count(None)
                except (OutcomeUnknown, TransactionConflict) as error:
                    count(error)

    async def write_async() -> None:
        async with await AsyncTransformClient.connect(endpoints, timeout_s=20) as tf:
            for _ in range(moves):
                try:
                    await tf.run_transaction(add_async, attempts=1)
                    count(None)
                except (OutcomeUnknown, TransactionConflict) as error:
                    count(error)

    with TcpProxy(primary.endpoint) as proxy, concurrent.futures.ThreadPoolExecutor(1) as pool:
        endpoints = [proxy.endpoint, primary.endpoint]
        work = write if kind == "synchronous" else lambda: asyncio.run(write_async())
        proxy.delay(0.002)
        writing = pool.submit(work)
        while not writing.done():
            proxy.reset()
            time.sleep(0.2)
        writing.result()
    with primary.connect(20) as tf:
        x = tf.lookup_latest_transform("map", "count").transform.translation[0]
    assert outcomes.total() == moves and outcomes[None]
    assert outcomes[None] <= x <= outcomes[None] + outcomes[OutcomeUnknown]
    assert outcomes[TransactionConflict] <= outcomes[OutcomeUnknown]
