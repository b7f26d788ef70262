"""Waiting lookups: what they may hold of a server, and when they are released."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.live_server import limited
from tests.processes.server_costs import cost_of, fill_chain, lookup
from tests.processes.servers import ServerProcess
from tests.support.raw import Raw, raw
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, TransformTree, wire
from zenoh_tf.errors import LimitExceeded, ServerBusy, ServerUnavailable
from zenoh_tf_client import TransformClient
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.requests.waiters import Waiters

pytestmark = pytest.mark.own_server

DEPTH = 999


def waiting(rows: int, target: str, source: str, timeout_s: float) -> bytes:
    return wire.pack(lookup(rows, target, source, timeout_ns=int(timeout_s * 1e9)))


def until_waiters(tf: TransformClient, count: int) -> None:
    wait_until(lambda: tf.stats()["waiters"] == count, tf.stats)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_waiting_rows_times_depth(server: ServerProcess, wires: Raw) -> None:
    """Two unconnected trees, so that every row would watch all frames of both."""
    fill_chain(wires, DEPTH, "a")
    fill_chain(wires, DEPTH, "b", "island")
    with cost_of(server.process.pid) as cost:
        error = wires.error("lookup", waiting(10_000, f"a{DEPTH}", f"b{DEPTH}", 9.0))
        assert isinstance(error, LimitExceeded)
        assert (error.field, error.limit) == ("waiter_links", 1_000_000)
    assert cost.peak_mb < 150.0
    with ThreadPoolExecutor(1) as pool, server.connect() as tf:
        # Few enough, they wait; then this client has had its share, and another one has not.
        fits = pool.submit(wires.query, "lookup", waiting(240, f"a{DEPTH}", f"b{DEPTH}", 5.0), 20.0)
        until_waiters(tf, 240)
        busy = wires.error("lookup", waiting(100, f"a{DEPTH}", f"b{DEPTH}", 9.0))
        assert isinstance(busy, ServerBusy)
        assert (busy.field, busy.limit) == ("waiter_links", 1_000_000)
        assert busy.retry_after_s is not None and busy.retry_after_s > 0
        assert not tf.can_transform(f"a{DEPTH}", f"b{DEPTH}", timeout_s=0.1)
        assert len(fits.result()["status"]) == 240


@pytest.mark.slow
def test_frames_that_move_below_waiting_lookups() -> None:
    """The tree counts what is watched in fact: a chain that grows after the lookups were parked
    does not make them watch more than is allowed."""
    with (
        limited(waiter_links=2000) as server,
        raw(server.endpoint) as wires,
        server.connect() as tf,
        ThreadPoolExecutor(1) as pool,
    ):
        tf.set_transform(StampedTransform("a", "b", 1, Transform()))
        asked = pool.submit(wires.query, "lookup", waiting(100, "b", "island", 10.0), 20.0)
        until_waiters(tf, 100)
        fill_chain(wires, 200, "c")
        tf.set_transform(StampedTransform("c200", "a", 1, Transform()))  # 200 links more each
        tf.set_transform(StampedTransform("x", "island", 1, Transform()))  # wakes them
        reply = asked.result()
        kinds = {wire.decode_error(error).code for _, error in reply["errors"]}
        assert LimitExceeded.code in kinds
        until_waiters(tf, 0)


def test_a_wait_has_a_limit(wires: Raw, client: TransformClient) -> None:
    error = wires.error("lookup", waiting(1, "a", "b", 601.0))
    assert isinstance(error, LimitExceeded)
    assert (error.field, error.limit, error.value) == ("timeout_s", 600, 601.0)
    with pytest.raises(LimitExceeded) as caught:
        client.lookup_transform("a", "b", timeout_s=601.0)
    assert (caught.value.field, caught.value.limit) == ("timeout_s", 600)


WAITER = """
import sys
from zenoh_tf_client import TransformClient
with TransformClient.connect(sys.argv[1], "main", 10.0) as tf, tf.batch() as batch:
    for row in range(50):
        batch.lookup_transform("nowhere", f"frame{row}", timeout_s=300.0)
"""


def test_waiters_of_a_killed_client_are_released(server: ServerProcess) -> None:
    with server.connect() as tf:
        command = [sys.executable, "-c", WAITER, server.endpoint]
        with forks.Popen(command) as process:
            try:
                until_waiters(tf, 50)
            finally:
                process.kill()
        until_waiters(tf, 0)


def test_a_reply_that_cannot_be_made_is_an_error(start_server: StartServer) -> None:
    """The request is answered, and the server continues to serve lookups that wait."""
    server = start_server("--limit", "reply_bytes=1000")
    with raw(server.endpoint) as wires, server.connect() as tf, ThreadPoolExecutor(1) as pool:
        for _ in range(3):
            asked = pool.submit(wires.query, "lookup", waiting(100, "map", "late", 9.0), 30.0)
            until_waiters(tf, 100)
            tf.set_transform(StampedTransform("map", "late", 1, Transform()))
            error = wire.decode_error(asked.result(10)["error"])
            assert isinstance(error, LimitExceeded) and error.field == "reply_bytes"
            tf.remove_frame("late")


def test_a_client_without_a_token_waits_for_a_short_time_only(server: ServerProcess) -> None:
    """Nobody says when it has gone: what it waits for would stay."""
    with raw(server.endpoint) as wires, server.connect() as tf:
        error = wires.error("lookup", waiting(1, "a", "b", 11.0))
        assert isinstance(error, ServerBusy)
        assert (error.field, error.limit, error.value) == ("timeout_s", 10, 11.0)
        assert tf.stats()["waiters"] == 0


def test_lookups_of_a_client_that_has_gone_meanwhile_do_not_wait() -> None:
    loop = asyncio.new_event_loop()
    waiters = Waiters(TransformTree(), Limits(), loop, lambda client: client == "here")
    lookups = [wire.parse_lookup(lookup(1, "a", "b", timeout_ns=10**9))]
    try:
        for client in ("here", "gone"):
            with (
                pytest.raises(ServerUnavailable, match="has gone")
                if client == "gone"
                else contextlib.nullcontext()
            ):
                waiters.ask(lookups, client, Limits().budget(), lambda _: None, lambda _: None)
        assert len(waiters._waiting) == 1
    finally:
        waiters.close()
        loop.close()
