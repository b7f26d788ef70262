"""What waits in the server is bounded and fair, and the SDK comes back when it is refused."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.support import messages
from tests.support.threads import beside
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf.errors import ServerBusy, ServerUnavailable
from zenoh_tf_client import TransformClient
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.transport.lanes import Lane, QueueShares

LIMITS = {"message_bytes": 1 << 20, "rows": 1000}  # what `hello` says


@dataclass
class Request:
    request_type: str
    client: str
    size: int


def request(client: str, size: int = 0, name: str = "lookup") -> Request:
    return Request(name, client, size)


def test_clients_take_turns() -> None:
    lane = Lane[Request](QueueShares(Limits()))
    for name in ("a1", "a2", "a3"):
        assert lane.enqueue(request("a", name=name)) is None
    assert lane.enqueue(request("b", name="b1")) is None
    assert lane.enqueue(request("c", name="c1")) is None
    taken = [lane.take() for _ in range(5)]
    assert [each.request_type for each in taken if each] == ["a1", "b1", "c1", "a2", "a3"]
    assert lane.take() is None


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        (Limits(client_pending_queries=2), "client_pending_queries"),
        (Limits(pending_queries=2), "pending_queries"),
        (Limits(client_pending_bytes=6000), "client_pending_bytes"),
        (Limits(pending_bytes=6000), "pending_bytes"),
    ],
)
def test_each_bound_refuses(limits: Limits, field: str) -> None:
    budget = QueueShares(limits)
    lane = Lane[Request](budget)
    other_lane = Lane[Request](budget)
    assert lane.enqueue(request("a", 2000)) is None
    assert other_lane.enqueue(request("a", 2000)) is None  # the bounds hold for all lanes together
    refusal = lane.enqueue(request("a", 2000))
    assert isinstance(refusal, ServerBusy)
    assert refusal.field == field
    assert refusal.retry_after_s is not None and refusal.retry_after_s > 0
    # Only a bound on one client leaves room for others.
    assert (lane.enqueue(request("b", 2000)) is None) == field.startswith("client_")
    assert lane.take() is not None
    assert other_lane.take() is not None
    assert lane.enqueue(request("a", 2000)) is None


def test_a_request_larger_than_the_bound_waits_alone() -> None:
    lane = Lane[Request](QueueShares(Limits(client_pending_bytes=5000)))
    assert lane.enqueue(request("a", 100_000)) is None
    assert isinstance(lane.enqueue(request("a")), ServerBusy)


def sample_payload(rows: int) -> bytes:
    body = messages.same_lookup(rows, "map", "base", op=wire.OP_LATEST, errors=False)
    return messages.pack(body)


def fill(tf: TransformClient) -> None:
    tf.set_transform(StampedTransform("map", "base", 1, Transform()))


def test_queries_beyond_the_limit_are_refused_and_not_run(start_server: StartServer) -> None:
    server = start_server("--limit", "pending_queries=1", "--workers", "1")
    outcomes: list[str] = []
    done = threading.Semaphore(0)

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            outcomes.append("answered")
            return
        assert reply.err is not None
        error = wire.decode_error(wire.unpack(reply.err.payload.to_bytes())["error"])
        assert isinstance(error, ServerBusy), error
        assert (error.field, error.limit) == ("pending_queries", 1)
        outcomes.append("refused")

    with server.connect() as tf, zenoh.open(zenoh_config.client([server.endpoint], 5.0)) as session:
        fill(tf)
        payload = sample_payload(20_000)  # a long one
        for _ in range(64):
            session.get(
                keys.request("main", "lookup"),
                zenoh.handlers.Callback(on_reply, done.release, indirect=False),
                payload=payload,
                timeout=150.0,
            )
        for _ in range(64):
            assert done.acquire(timeout=150.0)
        assert len(outcomes) == 64
        assert set(outcomes) == {"answered", "refused"}


def test_the_sdk_comes_back(start_server: StartServer) -> None:
    server = start_server("--limit", "pending_queries=1", "--workers", "1")
    stamps = np.arange(20_000)
    with server.connect(60.0) as tf, ThreadPoolExecutor(8) as pool:
        fill(tf)

        def ask(index: int) -> int:
            tf.set_transform(StampedTransform("map", f"b{index}", 1, Transform()))
            return len(tf.sample("map", "base", stamps))

        assert set(pool.map(ask, range(24))) == {len(stamps)}
        assert len(tf.frames()) == 26


def test_a_call_whose_time_is_over_asks_nothing_more() -> None:
    """A request that the server's rules deny ends at once: only then does the SDK ask for them."""
    endpoint = free_endpoint()
    hellos = 0
    held: list[zenoh.Query] = []

    def answer_hello(query: zenoh.Query) -> None:
        nonlocal hellos
        hellos += 1
        value = {"instance": "slow", "clock_ns": time.monotonic_ns(), "limits": LIMITS}
        with query:
            query.reply(query.key_expr, wire.pack({"v": 1, "instance": "slow", "value": value}))

    with zenoh.open(zenoh_config.router([endpoint])) as session:
        hello = session.declare_queryable(keys.request("main", "hello"), answer_hello)
        lookup = session.declare_queryable(keys.request("main", "lookup"), held.append)
        with TransformClient.connect(endpoint, timeout_s=1.0) as tf:
            with pytest.raises(ServerUnavailable, match="no answer"):
                tf.lookup_transform("map", "base")
            assert (len(held), hellos) == (1, 1)
        for query in held:
            query.drop()
        hello.undeclare()
        lookup.undeclare()


def test_hello_is_served_beside_long_requests(start_server: StartServer) -> None:
    server = start_server("--workers", "1")
    with server.connect(60.0) as busy_one, server.connect(60.0) as tf:
        fill(tf)

        def work(ending: threading.Event) -> None:
            while not ending.is_set():
                busy_one.sample("map", "base", np.arange(100_000))

        with beside(*4 * [work]):
            for _ in range(20):
                tf._connection.hello(10.0)
                assert tf.can_transform("map", "base")
