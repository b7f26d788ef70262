"""Mirrors of the SDK, on running servers."""

from __future__ import annotations

import gc
import math
import pickle
import threading
import time
import weakref
from functools import partial
from typing import Any

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.processes.tcp_proxy import TcpProxy
from tests.support.raw import raw
from tests.support.small_robot import stamped
from tests.support.threads import together
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.errors import (
    InvalidArgumentException,
    ServerRestarted,
    ServerUnavailable,
    TimeoutException,
    TransactionConflict,
)
from zenoh_tf_client import Mirror, Receipt, Transaction, TransformClient

DEADLINE_S = 30.0
either_client = pytest.mark.usefixtures("either_client")


@either_client
def test_a_lookup_waits_for_a_write(client: TransformClient) -> None:
    with client.mirror() as m:
        later = threading.Timer(0.2, client.set_transform, [stamped("base", 1, 5)])
        later.start()
        found = m.lookup_transform("map", "base", 1, timeout_s=DEADLINE_S)
        assert found.transform.translation[0] == 5
        later.join()


@either_client
def test_own_writes_are_read(client: TransformClient) -> None:
    with client.mirror() as m:
        for stamp in range(1, 200):
            client.set_transform(stamped("base", stamp, stamp))
            m.wait_for()
            assert m.lookup_transform("map", "base").stamp_ns == stamp
        with client.batch() as batch:
            batch.set_transform(stamped("arm", 1))
        m.wait_for()
        assert "arm" in m.frames()
        client.remove_frame("arm")
        m.wait_for()
        assert "arm" not in m.frames()
        client.clear()
        m.wait_for()
        assert m.parent("base") is None


@either_client
def test_a_receipt_of_another_process(server: ServerProcess, client: TransformClient) -> None:
    with server.connect() as other, other.mirror() as m:
        assert client.last_receipt is None
        m.wait_for()  # nothing was written
        client.set_transform(stamped("base", 1))
        receipt = pickle.loads(pickle.dumps(client.last_receipt))
        assert receipt == client.last_receipt
        m.wait_for(receipt)
        assert m.seq >= receipt.seq
        assert "base" in m.frames()
        with pytest.raises(TimeoutException):
            m.wait_for(Receipt(m.instance, receipt.seq + 1000), timeout_s=0.1)
        with pytest.raises(ServerRestarted):
            m.wait_for(Receipt("another", 1), timeout_s=0.1)


def test_the_age_is_measured(server: ServerProcess, client: TransformClient) -> None:
    """What was committed before the time that the age states can be read."""
    with server.connect() as other, other.mirror() as m:
        wait_until(lambda: m.age_s < 0.5, "no fresh state")
        for stamp in range(1, 30):
            client.set_transform(stamped("base", stamp))
            done_s = time.monotonic()
            deadline = done_s + DEADLINE_S
            while True:
                # In this order: what is read now is at least as new as this age.
                elapsed_s = time.monotonic() - done_s
                age_s = m.age_s
                if age_s < elapsed_s:
                    break
                assert time.monotonic() < deadline
            assert m.lookup_transform("map", "base").stamp_ns == stamp


def test_a_state_that_is_too_old_is_not_read(
    server: ServerProcess, client: TransformClient
) -> None:
    client.set_transform(stamped("base", 1))
    with (
        TcpProxy(server.endpoint) as proxy,
        TransformClient.connect(proxy.endpoint, timeout_s=0.5, reads="query") as other,
        other.mirror() as m,
    ):
        proxy.hold()
        wait_until(lambda: m.age_s > 0.3, "it does not age")
        client.set_transform(stamped("base", 2))
        pair = ("map", "base")
        assert m.lookup_latest_transform(*pair).stamp_ns == 1
        assert m.lookup_latest_transform(*pair, max_age_s=1000).stamp_ns == 1
        for ask in (
            lambda: m.lookup_latest_transform(*pair, max_age_s=0.3),
            lambda: m.lookup_latest_transform_xact(*pair, max_age_s=0.3),
            lambda: m.lookup_latest_transforms_xact([pair], max_age_s=0.3),
        ):
            with pytest.raises(ServerUnavailable):
                ask()
        proxy.release()
        assert m.lookup_latest_transform(*pair, max_age_s=-1).stamp_ns == 2
        assert m.lookup_latest_transform_xact(*pair, max_age_s=-1).stamp_ns == 2
        assert m.lookup_latest_transforms_xact([pair], max_age_s=-1)[0].stamp_ns == 2
        wait_until(lambda: m.age_s < 0.3, "it stays old")
        assert m.lookup_latest_transform(*pair).stamp_ns == 2


@either_client
def test_transactions_lose_no_update(server: ServerProcess, client: TransformClient) -> None:
    """Several mirrors increment one value; each conflict is found by the server."""
    client.set_transforms_xact([stamped("a", 1), stamped("b", 1)])
    pairs = [("map", "a"), ("map", "b")]
    kinds: list[dict[str, Any]] = [{}, {"pairs": pairs, "max_delay_s": 0}, {"max_rate_hz": 50}]
    rounds = 40

    def increment(kind: dict[str, Any]) -> None:
        with server.connect(20) as tf, tf.mirror(**kind) as m:
            for _ in range(rounds):
                m.run_transaction(step, attempts=1000)

    def step(tx: Transaction) -> None:
        a = tx.lookup_latest_transform_xact("map", "a")
        (b,) = tx.lookup_latest_transforms_xact([("map", "b")])
        assert a.transform == b.transform
        x = a.transform.translation[0] + 1
        stamp = a.stamp_ns + 1
        tx.set_transform(stamped("a", stamp, x))
        tx.set_transform(stamped("b", stamp, x))

    together(*(partial(increment, kind) for kind in kinds))
    assert client.lookup_transform("map", "b").transform.translation[0] == len(kinds) * rounds


@either_client
def test_a_transaction_that_only_reads_is_not_stale(
    server: ServerProcess, client: TransformClient
) -> None:
    client.set_transform(stamped("base", 1))
    with client.mirror() as m, server.connect() as other:

        def read(tx: Transaction) -> int:
            found = tx.lookup_latest_transform_xact("map", "base").stamp_ns
            if found == 1:  # another client writes in between
                other.set_transform(stamped("base", 2))
            return found

        assert m.run_transaction(read) == 2
        with pytest.raises(TransactionConflict):
            other.set_transform(stamped("base", 1))
            m.run_transaction(lambda tx: _move_and_read(tx, other), attempts=3)


def _move_and_read(tx: Transaction, other: TransformClient) -> None:
    stamp = tx.lookup_latest_transform_xact("map", "base").stamp_ns
    other.set_transform(stamped("base", stamp + 1))


def test_one_round_trip_for_a_transaction(
    client: TransformClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.set_transforms_xact([stamped("a", 1), stamped("b", 1)])
    queries = client._connection.queries
    asked: list[str] = []

    def ask(key: zenoh.KeyExpr, payload: bytes, timeout_s: float) -> Any:
        asked.append(str(key))
        return type(queries).ask(queries, key, payload, timeout_s)

    with client.mirror() as m:

        def step(tx: Transaction) -> None:
            found = tx.lookup_transform("map", "a"), tx.lookup_transform("map", "b")
            tx.set_transform(stamped("a", max(one.stamp_ns for one in found) + 1))

        m.wait_for()
        monkeypatch.setattr(queries, "ask", ask)
        m.run_transaction(step)
        assert [key for key in asked if not key.endswith("/hello")] == ["tf/v1/main/commit"]


@either_client
def test_a_closed_mirror(server: ServerProcess) -> None:
    tf = server.connect()
    m = tf.mirror()
    m.close()
    m.close()
    assert math.isinf(m.age_s)
    for call in (
        m.frames,
        lambda: m.lookup_transform("map", "base"),
        lambda: m.estimate_transform("map", "base", 1),
    ):
        with pytest.raises(ServerUnavailable):
            call()
    with pytest.raises(ServerUnavailable):
        m.run_transaction(lambda tx: None)
    other = tf.mirror()
    assert other.frames() == []
    tf.close()
    wait_until(lambda: "closed" in repr(other), "the client is closed, but its mirror is not")
    with pytest.raises(ServerUnavailable):
        other.frames()
    with pytest.raises(ServerUnavailable):
        tf.mirror()


def test_mirrors_leave_nothing_behind(client: TransformClient) -> None:
    threads = threading.active_count()
    for _ in range(3):
        with client.mirror() as m:
            assert m.frames() == []
    unreferenced = weakref.ref(client.mirror())
    gc.collect()
    assert unreferenced() is None
    wait_until(lambda: threading.active_count() <= threads, "threads are left")


@either_client
def test_several_mirrors_of_one_client(client: TransformClient) -> None:
    with client.mirror() as one, client.mirror() as two:
        client.set_transform(stamped("base", 1))
        one.wait_for()
        two.wait_for()
        one.close()
        client.set_transform(stamped("base", 2))
        two.wait_for()
        assert two.lookup_transform("map", "base").stamp_ns == 2


def test_a_server_that_is_gone(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as tf:
        server.kill()
        with pytest.raises(ServerUnavailable):
            tf.mirror(timeout_s=0.5)
        with pytest.raises(InvalidArgumentException, match="timeout_s"):
            tf.mirror(timeout_s=0)


def test_a_malformed_message_is_a_gap(server: ServerProcess, client: TransformClient) -> None:
    with client.mirror() as m, raw(server.endpoint) as attacker:
        key = keys.stream("main", m.instance)
        for payload in (b"", b"\x00", b"\xc1" * 10, wire.pack({"v": 1, "instance": m.instance})):
            attacker.session.put(key, payload)
        client.set_transform(stamped("base", 1))
        m.wait_for()
        assert isinstance(m, Mirror)
        assert "base" in m.frames()
