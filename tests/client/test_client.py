"""The SDK against a real server. That reads are the embedded tree's is in test_answers.py."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf.errors import (
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    ServerBusy,
    ServerUnavailable,
)
from zenoh_tf_client import Broadcaster, TransformClient

pytestmark = pytest.mark.usefixtures("either_client")

S = 1_000_000_000


def link(parent: str, child: str, stamp_ns: int, x: float = 0.0) -> StampedTransform:
    half = np.sqrt(0.5)
    return StampedTransform(
        parent, child, stamp_ns, Transform((x, 1.0, 2.0), (0.0, 0.0, half, half))
    )


LINKS = [
    link("map", "odom", 1 * S, 1.0),
    link("map", "odom", 3 * S, 3.0),
    link("odom", "base", 2 * S, 0.5),
    link("odom", "base", 4 * S, 0.7),
    link("island", "shore", 1 * S),
]


def fill(tf: TransformClient | TransformTree) -> None:
    for stamped in LINKS:
        assert tf.set_transform(stamped) is True
    tf.set_transforms_xact([link("base", "camera", 0), link("base", "arm", 0)], "urdf", static=True)


def test_an_endpoint_is_no_connection() -> None:
    with pytest.raises(TypeError, match=r"use TransformClient\.connect\(") as caught:
        TransformClient("tcp/127.0.0.1:7447")  # type: ignore[arg-type]
    assert "'tcp/127.0.0.1:7447'" in str(caught.value)


def test_what_is_no_transform_is_named(server: ServerProcess) -> None:
    X: Any = Transform()
    one: Any = link("map", "base", 1)
    with server.connect() as tf, tf.broadcaster("lidar") as sensor:
        calls: list[tuple[Any, Any, str]] = [
            (tf.set_transform, X, "stamped"),
            (tf.set_transforms_xact, one, "stampeds"),
            (tf.set_transforms_xact, [one, X], "stampeds"),
            (sensor.send, X, "stampeds"),
            (sensor.send_static, X, "stampeds"),
            (sensor.send_static, [one, None], "stampeds"),
        ]
        for call, wrong, field in calls:
            with pytest.raises(InvalidArgumentException, match=f"^{field} must be a ") as caught:
                call(wrong)
            assert caught.value.field == field
            assert repr(wrong) in str(caught.value)
        assert tf.frames() == []


def test_reprs(server: ServerProcess) -> None:
    where = f"{server.endpoint}, tree 'main'"
    with server.connect() as tf:
        assert repr(tf) == f"<TransformClient {where}, server {tf.instance}, open>"
        sensor = tf.broadcaster("lidar")
        sensor.send_static(link("base", "lidar", 0))
        assert repr(sensor) == f"<Broadcaster 'lidar' at {where}, 1 static, open>"
        with tf.transaction() as tx:
            tx.can_transform("map", "base")
            seen = f"<Transaction of 1 reads and 0 sets at {where}, server {tf.instance}, open>"
            assert repr(tx) == seen
        with tf.batch() as batch:
            unknown, can = batch.frame("base 2"), batch.can_transform("map", "base")
            assert repr(batch) == f"<Batch of 2 operations for {where}, open>"
            assert repr(can) == "<Handle: not sent>"
        assert repr(can) == "<Handle: False>"
        assert repr(unknown).startswith("<Handle: LookupException(")
        sensor.close()
        assert repr(sensor).endswith("closed>")
    for closed in (tf, tx, batch):
        assert repr(closed).endswith("closed>")


def test_a_closed_client_says_so(server: ServerProcess) -> None:
    tf = server.connect()
    sensor = tf.broadcaster("lidar")
    tf.close()
    tf.close()
    sensor.close()
    for call in (tf.frames, lambda: sensor.send(link("a", "b", 1)), lambda: tf.broadcaster("b")):
        with pytest.raises(ServerUnavailable, match="is closed"):
            call()


def test_any_utf8_name(start_server: StartServer) -> None:
    server = start_server(tree="a/b %*@机")
    with server.connect() as tf, tf.broadcaster("lidar/front #1") as sensor:
        tf.set_transform(link("a//b", "**", 1 * S), authority="$*")
        assert tf.lookup_transform("a//b", "**").child_frame == "**"
        assert tf.frame("**").authority == "$*"
        sensor.send(link("🤖", "e\u0301\x01", 1 * S))
        assert tf.can_transform("🤖", "e\u0301\x01", timeout_s=5.0)
        assert tf.frame("e\u0301\x01").authority == "lidar/front #1"
        with pytest.raises(InvalidArgumentException):
            tf.lookup_transform("\ud800", "x")


@pytest.mark.parametrize("method", ["send", "send_static"])
def test_a_broadcaster_is_closed_while_another_thread_sends(
    client: TransformClient, method: str
) -> None:
    """Each message before is sent, the first after it is refused, and close() does not fail."""

    def send_until_refused(broadcaster: Broadcaster, sent: threading.Event) -> int:
        for n in range(1_000_000):
            try:
                getattr(broadcaster, method)(link("map", "base", n))
            except ServerUnavailable:
                return n
            sent.set()
        raise AssertionError("never refused")

    with ThreadPoolExecutor(4) as threads:
        for _ in range(20):
            broadcaster = client.broadcaster("sensor")
            events = [threading.Event() for _ in range(4)]
            senders = [threads.submit(send_until_refused, broadcaster, sent) for sent in events]
            assert all(sent.wait(10) for sent in events)
            broadcaster.close()
            assert all(sender.result(10) > 0 for sender in senders)
    # The next test begins with an empty tree: what waits for its commit would come after that.
    with client.broadcaster("sensor") as last:
        getattr(last, method)(link("map", "last", 1))
        assert client.can_transform("map", "last", timeout_s=10)


def test_batch(client: TransformClient) -> None:
    fill(client)
    with client.batch() as batch:
        first = batch.lookup_transform("map", "base")
        unknown = batch.lookup_transform("map", "nowhere")
        latest = batch.lookup_latest_transform("map", "base")
        common = batch.latest_common_time("map", "base")
        stored = batch.set_transform(link("map", "odom", 5 * S, 5.0))
        refused = batch.set_transforms_xact([link("a", "a", 1)])
        after = batch.lookup_transform("map", "odom")
        can = batch.can_transform("map", "nowhere")
        array = batch.sample("map", "odom", [3 * S, 4 * S])
        full = batch.lookup_transform_full("odom", 1 * S, "odom", 3 * S, "map")
        record = batch.frame("odom")
        chain = batch.chain("map", "base")
        with pytest.raises(RuntimeError):
            first.result()
    assert first.result().stamp_ns == 3 * S
    assert isinstance(unknown.exception(), LookupException)
    with pytest.raises(LookupException):
        unknown.result()
    assert latest.result().newest_stamp_ns == 4 * S
    assert common.result() == 3 * S
    assert stored.result() is True
    assert isinstance(refused.exception(), InvalidArgumentException)
    assert after.result().stamp_ns == 5 * S
    assert can.result() is False
    assert array.result().status.tolist() == [0, 0]
    assert full.result().parent_frame == "odom"
    assert record.result().parent == "map"
    assert chain.result() == client.chain("map", "base")


def test_a_batch_that_is_left_by_an_error_is_not_sent(client: TransformClient) -> None:
    with pytest.raises(KeyError), client.batch() as batch:
        batch.set_transform(link("map", "base", 1 * S))
        raise KeyError
    assert client.frames() == []


def test_a_batch_that_writes_and_waits(client: TransformClient) -> None:
    with client.batch() as batch:
        stored = batch.set_transform(link("map", "base", 1))
        refused = batch.lookup_transform("map", "late", timeout_s=5.0)
    assert stored.result() is True
    assert isinstance(refused.exception(), InvalidArgumentException)
    with client.batch() as batch:
        now = batch.lookup_transform("map", "base", timeout_s=5.0)
        unknown = batch.lookup_transform("map", "late", timeout_s=0.1)
    assert now.result().stamp_ns == 1
    assert isinstance(unknown.exception(), LookupException)


def test_waiting_lookups(any_server: ServerProcess) -> None:
    with (
        any_server.connect() as tf,
        any_server.connect() as other,
        ThreadPoolExecutor(20) as pool,  # more than the server has workers
    ):
        fill(tf)
        late = [f"late{row % 4}" for row in range(20)]
        answers = [pool.submit(tf.lookup_transform, "map", each, timeout_s=20.0) for each in late]
        while other.stats()["waiters"] < 20:
            pass
        assert other.can_transform("map", "base")  # a worker is free
        other.set_transforms_xact([link("map", f"late{row}", 1 * S) for row in range(4)])
        assert [answer.result(10).child_frame for answer in answers] == late
        assert other.stats()["waiters"] == 0
        with pytest.raises(LookupException):
            tf.lookup_transform("map", "nowhere", timeout_s=0.2)
        assert not tf.can_transform("map", "base", 9 * S, timeout_s=0.2)
        with pytest.raises(ExtrapolationException):
            tf.lookup_transform_full("map", 9 * S, "base", 2 * S, "odom", timeout_s=0.2)


def test_more_waiters_than_allowed(start_server: StartServer) -> None:
    server = start_server("--limit", "waiters=1")
    with server.connect(2.0) as tf, ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(tf.can_transform, "a", "b", timeout_s=60.0)
        while tf.stats()["waiters"] < 1:
            pass
        with pytest.raises(ServerBusy) as caught:
            tf.lookup_transform("a", "b", timeout_s=0.1)
        assert (caught.value.field, caught.value.limit) == ("waiters", 1)
        tf.set_transform(link("a", "b", 1 * S))
        assert waiting.result(10)
