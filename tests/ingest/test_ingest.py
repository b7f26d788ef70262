"""Ingest of puts over real servers: fair, in order, and without loss where nobody is harmed."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import AuthorityInfo, StampedTransform, Transform, wire
from zenoh_tf._net import keys
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests import columns

pytestmark = pytest.mark.own_server

TIMEOUT_S = 60.0


def rows(name: str, stamp_ns: int, count: int = 10) -> list[StampedTransform]:
    return [StampedTransform("map", f"{name}{i}", stamp_ns, Transform()) for i in range(count)]


def authority(tf: TransformClient, name: str) -> AuthorityInfo | None:
    return next((each for each in tf.authorities() if each.name == name), None)


def test_a_publisher_alone_is_held_back_and_loses_nothing(start_server: StartServer) -> None:
    server = start_server("--limit", "put_queue_bytes=20000")
    with server.connect() as tf, tf.broadcaster("burst") as burst:
        for stamp_ns in range(3000):
            burst.send(rows("f", stamp_ns))
        wait_until(lambda: tf.stats()["put_transforms"] == 30_000, tf.stats)
        assert tf.stats()["dropped_by_queue"] == 0
        assert tf.frame("f0").samples == 3000


def flood(endpoint: str, name: str, stop: threading.Event) -> None:
    """Send the same message again and again, which costs the sender next to nothing."""
    # Large, as the receiver takes no more small ones than it can commit.
    payload = wire.pack(wire.commit_body(columns.commit(rows(name, 1, 40_000))))
    with raw(endpoint) as wires:
        publisher = wires.session.declare_publisher(
            keys.put("main", name, static=False),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        while not stop.is_set():
            publisher.put(payload)


def test_floods_lose_and_a_sensor_beside_them_does_not(start_server: StartServer) -> None:
    # Three messages of a flood fill its queue. They must not become stale before.
    server = start_server("--limit", "put_queue_bytes=10000000", "--limit", "put_wait_ms=600000")
    stop = threading.Event()
    with server.connect() as tf:
        threads = [
            threading.Thread(target=flood, args=(server.endpoint, name, stop))
            for name in ("flood 1", "flood 2")
        ]
        for thread in threads:
            thread.start()
        try:
            sensor = tf.broadcaster("sensor")
            sent = 0

            def dropped() -> bool:
                nonlocal sent
                sent += 1
                sensor.send(rows("s", sent, 1))
                return tf.stats()["dropped_by_queue"] > 0

            wait_until(dropped, tf.stats)
        finally:
            stop.set()
            for thread in threads:
                thread.join()
        wait_until(
            lambda: (seen := authority(tf, "sensor")) and seen.stored == sent, tf.authorities
        )

        def all_lost_are_counted() -> bool:  # puts of the floods may still be queued
            lost = {each.name: each.dropped_by_queue for each in tf.authorities()}
            assert lost["sensor"] == 0
            return bool(sum(lost.values()) == tf.stats()["dropped_by_queue"] > 0)

        wait_until(all_lost_are_counted, tf.authorities)
        assert "puts of 'flood" in server.log and "its queue is full" in server.log


def test_static_and_dynamic_puts_of_an_authority_keep_their_order(server: ServerProcess) -> None:
    with server.connect() as tf, tf.broadcaster("driver") as driver:
        sent = 0
        for _ in range(200):
            driver.send(StampedTransform("map", "base", 1, Transform()))
            driver.send_static(StampedTransform("map", "base", 1, Transform()))
            driver.send(StampedTransform("map", "base", 2, Transform()))
            sent += 3
        wait_until(lambda: tf.stats()["puts"] == sent, tf.stats)
        info = tf.frame("base")
        assert (info.static, info.newest_stamp_ns, info.switched) == (False, 2, 400)
        assert info.samples == 1


def test_one_large_put_holds_up_nobody_and_is_atomic(server: ServerProcess) -> None:
    with server.connect() as tf, tf.broadcaster("map maker") as large:
        large.send(rows("cell", 1, 20_000))
        large.send(rows("last", 1, 1))  # after the large one, as sent
        wait_until(lambda: "last0" in tf.frames(), tf.stats)
        assert tf.stats()["put_transforms"] == 20_001
        assert tf.frame("cell19999").samples == 1


def test_puts_on_other_keys_are_ignored(server: ServerProcess) -> None:
    with server.connect() as tf:
        session = tf.broadcaster("x")._connection.session
        for key in ("tf/v1/main/lookup/x", "tf/v1/main/server/x", "tf/v1/main/x/y"):
            session.put(key, b"x")
        with tf.broadcaster("good") as good:
            good.send(rows("f", 1))
        wait_until(lambda: tf.stats()["puts"] == 1, tf.stats)
        assert tf.stats()["bad_puts"] == 0


class HeldIngest(ServerProcess):
    """A server whose ingest thread receives puts from Zenoh and never commits one."""

    START = (
        "-c",
        "import sys, threading\n"
        "from zenoh_tf_server.ingest.ingest import Ingest\n"
        "Ingest._serve = lambda *_: threading.Event().wait()\n"
        "from zenoh_tf_server.main import main; sys.exit(main())",
    )


@pytest.fixture
def held_ingest(tmp_path: Path) -> Iterator[ServerProcess]:
    server = HeldIngest(tmp_path / "log", free_endpoint(), "main", ())
    yield server
    server.stop()


def test_lookups_are_answered_while_puts_are_not_taken(held_ingest: ServerProcess) -> None:
    sent = [0] * 6
    payload = bytes(60_000)

    def flood(publisher: zenoh.Publisher, index: int) -> None:
        with suppress(zenoh.ZError):  # the session is closed
            while True:
                publisher.put(payload)
                sent[index] += 1

    with ExitStack() as stack:
        before = stack.enter_context(held_ingest.connect())
        before.set_transform(StampedTransform("map", "base", 1, Transform()))
        for index in range(len(sent)):
            wires = stack.enter_context(raw(held_ingest.endpoint))
            publisher = wires.session.declare_publisher(
                keys.put("main", f"flood {index}", static=False),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            threading.Thread(target=flood, args=(publisher, index), daemon=True).start()
        seen: list[int] = []
        while seen != sent or 0 in sent:  # until Zenoh holds all of them back
            seen = sent.copy()
            time.sleep(0.3)
        for client in (before, stack.enter_context(held_ingest.connect())):
            assert client.lookup_transform("map", "base").stamp_ns == 1
        held_ingest.kill()  # ends the publishers' waiting
