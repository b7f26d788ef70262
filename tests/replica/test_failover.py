"""Readers with several endpoints, whose nearest replica, primary or router is lost and comes back.

No read is wrong, none is older than what its client has read before, and none fails.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import signal
import threading
import time
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
from zenoh_tf.errors import OutcomeUnknown, ServerUnavailable, TransformException
from zenoh_tf_client import AsyncTransaction, AsyncTransformClient, Transaction, TransformClient

#: Reads that each reader makes between two steps of a test.
READS = 20


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
        with TransformClient.connect(self._endpoints, timeout_s=20) as tf:
            self.clients["client"] = tf
            while not self._ending.is_set():
                self._record("client", seen(tf))

    def _read_mirror(self) -> None:
        with TransformClient.connect(self._endpoints, timeout_s=20) as tf, tf.mirror() as m:
            self.clients["mirror"] = tf
            while not self._ending.wait(0.005):
                self._record("mirror", seen(m))  # type: ignore[arg-type]

    async def _read_async(self) -> None:
        pairs = [("map", name) for name in FRAMES]
        async with await AsyncTransformClient.connect(self._endpoints, timeout_s=20) as tf:
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


@contextmanager
def silent(server: ServerProcess, proxy: TcpProxy, how: str) -> Iterator[None]:
    """The server is stopped, or cut off behind the proxy."""
    if how == "stopped":
        server.freeze()
        yield
        server.send_signal(signal.SIGCONT)
    else:
        proxy.hold()
        yield
        proxy.release()


# --- the nearest replica, a router


def test_reads_continue_when_the_nearest_replica_is_killed(
    primary: ServerProcess, start_replica: StartServer
) -> None:
    near, far = start_replica(primary), start_replica(primary)
    with writer(primary) as last, readers(near.endpoint, far.endpoint) as reading:
        assert reading.are_at(near.endpoint)
        near.kill()
        wait_until(lambda: reading.are_at(far.endpoint), "somebody has not moved")
        is_fresh(reading, last)
        start_replica(primary, endpoint=near.endpoint)
        wait_until(lambda: reading.are_at(near.endpoint), "somebody does not return")
        is_fresh(reading, last)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["stopped", "cut off"])
def test_reads_continue_when_the_nearest_replica_is_silent(
    how: str, primary: ServerProcess, start_replica: StartServer
) -> None:
    near, far = start_replica(primary), start_replica(primary)
    with TcpProxy(near.endpoint) as proxy, writer(primary) as last:
        where = near.endpoint if how == "stopped" else proxy.endpoint
        with readers(where, far.endpoint, primary.endpoint) as reading:
            for _ in range(3):
                assert reading.are_at(where)
                with silent(near, proxy, how):
                    wait_until(lambda: reading.are_at(far.endpoint), "somebody has not moved")
                    is_fresh(reading, last)
                wait_until(lambda: reading.are_at(where), "somebody does not return")
                is_fresh(reading, last)


@pytest.mark.slow
def test_reads_continue_when_a_router_is_lost(primary: ServerProcess) -> None:
    """The clients reach the primary through either of two routers."""
    near, far = RouterProcess(primary.endpoint), RouterProcess(primary.endpoint)
    try:
        with writer(primary) as last, readers(near.endpoint, far.endpoint) as reading:
            near.freeze()
            wait_until(lambda: reading.are_at(far.endpoint), "somebody has not moved")
            is_fresh(reading, last)
            near.go_on()
            wait_until(lambda: reading.are_at(near.endpoint), "somebody does not return")
            is_fresh(reading, last)
            near.kill()
            wait_until(lambda: reading.are_at(far.endpoint), "somebody has not moved")
            is_fresh(reading, last)
    finally:
        near.kill()
        far.kill()


# --- the primary


@pytest.mark.slow
@pytest.mark.parametrize("how", ["stopped", "cut off"])
def test_reads_continue_at_a_replica_when_the_primary_is_silent(
    how: str, primary: ServerProcess, start_replica: StartServer
) -> None:
    replica = start_replica(primary)
    with TcpProxy(primary.endpoint) as proxy, writer(primary) as last:
        where = primary.endpoint if how == "stopped" else proxy.endpoint
        with readers(where, replica.endpoint) as reading:
            with silent(primary, proxy, how):
                wait_until(lambda: reading.are_at(replica.endpoint), "somebody has not moved")
                reading.go_on()
            wait_until(lambda: reading.are_at(where), "somebody does not return")
            is_fresh(reading, last)


@pytest.mark.slow
def test_reads_continue_at_a_replica_when_the_primary_is_killed(
    primary: ServerProcess, start_server: StartServer, start_replica: StartServer
) -> None:
    """A new primary has another tree, which every reader then has."""
    replica = start_replica(primary)
    with primary.connect(20) as tf:
        tf.set_transforms_xact(step(7))
    with readers(primary.endpoint, replica.endpoint) as reading:
        primary.kill()
        wait_until(lambda: reading.are_at(replica.endpoint), "somebody has not moved")
        reading.go_on()
        assert set(reading.last.values()) == {7}
    with TransformClient.connect([primary.endpoint, replica.endpoint], timeout_s=20) as tf:
        assert (seen(tf), tf.endpoint) == (7, replica.endpoint)
        start_server(endpoint=primary.endpoint)
        wait_until(lambda: tf.endpoint == primary.endpoint, "it does not return")
        tf.set_transforms_xact(step(8))
        assert seen(tf) == 8


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


# --- writes


def one_more(latest: LatestTransform) -> StampedTransform:
    x = latest.transform.translation[0] + 1
    return StampedTransform("map", "count", latest.stamp_ns + 1, Transform((x, 0, 0)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["synchronous", "asynchronous"])
def test_writes_are_executed_once_whatever_becomes_of_the_link(
    kind: str, primary: ServerProcess, start_replica: StartServer
) -> None:
    """The link is lost again and again; each write gets its first reply all the same."""
    replica = start_replica(primary)
    moves = 300
    with primary.connect(20) as tf:
        tf.set_transform(StampedTransform("map", "count", 1, Transform()))

    def add(tx: Transaction) -> None:
        tx.set_transform(one_more(tx.lookup_latest_transform_xact("map", "count")))

    async def add_async(tx: AsyncTransaction) -> None:
        tx.set_transform(one_more(await tx.lookup_latest_transform_xact("map", "count")))

    def write() -> None:
        with TransformClient.connect(endpoints, timeout_s=20) as tf:
            for _ in range(moves):
                tf.run_transaction(add, attempts=1)

    async def write_async() -> None:
        async with await AsyncTransformClient.connect(endpoints, timeout_s=20) as tf:
            for _ in range(moves):
                await tf.run_transaction(add_async, attempts=1)

    with TcpProxy(replica.endpoint) as proxy, concurrent.futures.ThreadPoolExecutor(1) as pool:
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
    assert x == moves
