"""The commit stream, snapshots and missed messages of a running server."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import pytest
import zenoh

from tests.conftest import StartServer
from tests.processes.live_server import LiveServer, limited
from tests.processes.servers import ServerProcess
from tests.support.raw import Raw, raw
from tests.support.small_robot import stamped
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeReplay
from zenoh_tf._net import keys
from zenoh_tf.errors import LimitExceeded, ProtocolError, ServerRestarted

DEADLINE_S = 30.0


class Listener:
    """A simple mirror: it follows the stream of a tree."""

    def __init__(self, client: Raw) -> None:
        self.client = client
        self.messages: queue.Queue[wire.StreamMessage] = queue.Queue()
        self._subscriber = client.session.declare_subscriber(
            keys.streams(client.tree), self._received
        )
        self.tree = TransformTree()
        self.replay = ChangeReplay(self.tree)
        self.instance = ""
        self.position = 0

    def _received(self, sample: zenoh.Sample) -> None:
        body = wire.unpack(sample.payload.to_bytes())
        message = wire.parse_stream(body)
        assert str(sample.key_expr) == keys.stream(self.client.tree, message.instance)
        self.messages.put(message)

    def close(self) -> None:
        self._subscriber.undeclare()

    def load(self) -> None:
        """Begin with a snapshot."""
        self.instance, self.position = snapshot(self.client, self.tree, self.replay)

    def next(self) -> wire.StreamMessage:
        return self.messages.get(timeout=DEADLINE_S)

    def apply(self, message: wire.StreamMessage) -> None:
        """Apply a message, which must follow the last one."""
        assert message.instance == self.instance
        if message.last <= self.position:
            return
        assert message.first <= self.position + 1, "a message is missing"
        if message.changes is not None:
            self.replay.apply(message.last, message.changes)
        self.position = message.last

    def follow(self, until: Any) -> None:
        """Apply what comes until `until()` is true. A busy machine loses messages."""
        deadline = time.monotonic() + DEADLINE_S
        while not until():
            assert time.monotonic() < deadline
            message = self.next()
            if message.first > self.position + 1:
                self.repair()
            if message.first <= self.position + 1:
                self.apply(message)

    def repair(self) -> None:
        """Ask for what is missing, or restart."""
        messages = self.missed()
        for message in messages:
            self.apply(message)
        if not messages:
            self.tree = TransformTree()
            self.replay = ChangeReplay(self.tree)
            self.load()

    def missed(self) -> list[wire.StreamMessage]:
        """What the server still has of the messages after the last one."""
        request = wire.missed_request(self.instance, self.position + 1)
        reply = self.client.query("missed", request)
        messages, _ = wire.parse_missed_reply(reply)
        return [wire.parse_stream(wire.unpack(data)) for data in messages]


def snapshot(client: Raw, tree: TransformTree, replay: ChangeReplay) -> tuple[str, int]:
    """Load a snapshot of the server's tree; return the server's instance and the number."""
    reply = client.query("snapshot", wire.snapshot_request(None))
    plan = wire.parse_snapshot_plan(reply)
    if plan.ever_reparented:
        replay.set_ever_reparented()
    instance: str = reply["instance"]
    for piece, (after, until) in enumerate(zip(plan.bounds[:-1], plan.bounds[1:], strict=True)):
        reached = int(after)
        while reached < until:
            request = wire.SnapshotRequest(instance, piece, reached, int(until))
            answer = client.query("snapshot", wire.snapshot_request(request))
            got = wire.parse_snapshot_piece(answer)
            assert got.piece == piece
            replay.load(got.frames)
            reached = got.reached
    return instance, plan.seq


@contextmanager
def listening(server: ServerProcess | LiveServer) -> Iterator[Listener]:
    with raw(server.endpoint) as client:
        listener = Listener(client)
        try:
            yield listener
        finally:
            listener.close()


def stats(server: ServerProcess) -> dict[str, int]:
    with server.connect() as tf:
        return tf.stats()


def test_a_silent_server_sends_heartbeats(server: ServerProcess) -> None:
    with listening(server) as listener:
        listener.load()
        beats = [listener.next() for _ in range(5)]
        assert all(beat.changes is None for beat in beats)
        assert all(beat.first == beat.last + 1 for beat in beats)
        clocks = [beat.clock_ns for beat in beats]
        assert clocks == sorted(set(clocks))


@pytest.mark.own_server
def test_nothing_is_published_while_nobody_listens(server: ServerProcess) -> None:
    with server.connect() as tf:
        assert tf.set_transform(stamped("base", 1))
        assert tf.stats()["stream_messages"] == 0
        assert tf.stats()["change_log_bytes"] == 0
        with listening(server) as listener:
            listener.next()
        deadline = time.monotonic() + DEADLINE_S
        while True:  # until the server has heard that the listener is gone
            published = tf.stats()["stream_messages"]
            time.sleep(0.3)
            if tf.stats()["stream_messages"] == published:
                break
            assert time.monotonic() < deadline
        assert tf.set_transform(stamped("base", 2))
        assert tf.stats()["change_log_bytes"] == 0
        assert tf.stats()["stream_kept_bytes"] == 0


def test_missed_messages_are_sent_again(server: ServerProcess) -> None:
    with server.connect() as tf, listening(server) as listener:
        listener.load()
        for stamp in range(1, 200):
            tf.set_transform(stamped("base", stamp, stamp))
        deadline = time.monotonic() + DEADLINE_S
        tree = listener.tree
        while not tree.frames() or tree.frame("base").newest_stamp_ns != 199:
            assert time.monotonic() < deadline
            for message in listener.missed():  # instead of what was heard
                listener.apply(message)
        assert tree.frame("base").version == tf.frame("base").version
        assert tree.frame("base").samples == 199


def test_forgotten_messages_are_not_sent(start_server: StartServer) -> None:
    server = start_server("--limit", "stream_bytes=2000")
    with server.connect() as tf, listening(server) as listener:
        listener.load()
        for stamp in range(1, 200):
            tf.set_transform(stamped("base", stamp))
        listener.follow(
            lambda: listener.tree.frames() and listener.tree.frame("base").newest_stamp_ns == 199
        )
        request = wire.missed_request(listener.instance, 1)
        reply = listener.client.query("missed", request)
        messages, last = wire.parse_missed_reply(reply)
        assert messages == []
        assert last >= 199
        assert tf.stats()["stream_kept_bytes"] <= 2000


def test_a_log_that_overflows_is_a_gap() -> None:
    with (
        limited(change_log_bytes=3000) as server,
        server.connect() as tf,
        listening(server) as listener,
    ):
        listener.load()
        small, large = [stamped("small", 1)], [stamped(f"frame{i}", 1) for i in range(100)]
        tf.set_transforms_xact(small)
        listener.follow(lambda: len(listener.tree.frames()) == 2)
        tf.set_transforms_xact(large)  # one commit that the log cannot hold
        while (message := listener.next()).first <= listener.position + 1:
            listener.apply(message)
        assert len(listener.tree.frames()) == 2
        assert tf.stats()["stream_gaps"] >= 1
        listener.tree = TransformTree()
        listener.replay = ChangeReplay(listener.tree)
        listener.load()
        assert len(listener.tree.frames()) == 102
        tf.set_transform(stamped("small", 2))
        listener.follow(lambda: listener.tree.frame("small").newest_stamp_ns == 2)


def test_a_restarted_server_is_another_instance(start_server: StartServer) -> None:
    first = start_server()
    with listening(first) as listener:
        listener.load()
        old = listener.instance
        first.stop()
        second = start_server(endpoint=first.endpoint)
        with second.connect() as tf:
            tf.set_transform(stamped("base", 1))
            deadline = time.monotonic() + DEADLINE_S
            while (message := listener.next()).instance == old:
                assert time.monotonic() < deadline
            request = wire.SnapshotRequest(old, 0, 0, 10)
            for request_type, body in (
                ("snapshot", wire.snapshot_request(request)),
                ("missed", wire.missed_request(old, 1)),
            ):
                error = listener.client.error(request_type, body)
                assert isinstance(error, ServerRestarted)
            listener.load()
            assert listener.instance == message.instance
            assert listener.tree.frames() == tf.frames()


def test_a_stopped_listener_harms_nobody(server: ServerProcess) -> None:
    """One listener reads nothing; writes, lookups and another listener continue."""
    release = threading.Event()

    def hold(_: zenoh.Sample) -> None:
        release.wait()

    with raw(server.endpoint) as slow, server.connect() as tf, listening(server) as listener:
        # A direct callback that blocks stops the whole session from reading its link.
        blocked = slow.session.declare_subscriber(
            keys.streams("main"), cast("Any", zenoh.handlers.Callback(hold, indirect=False))
        )
        try:
            listener.load()
            for stamp in range(1, 400):  # 20 kB each, more than all buffers hold
                tf.set_transforms_xact([stamped(f"frame{i}", stamp) for i in range(200)])
                assert tf.lookup_transform("map", "frame0").stamp_ns == stamp
            version = tf.frame("frame7").version
            listener.follow(
                lambda: listener.tree.frames() and listener.tree.frame("frame7").version == version
            )
            assert listener.tree.frame("frame7").samples == 399
        finally:
            release.set()
            blocked.undeclare()


def test_a_snapshot_comes_in_pieces(server: ServerProcess) -> None:
    with server.connect() as tf, raw(server.endpoint) as client:
        rows = 2000
        for stamp in range(1, 21):
            tf.set_transforms_xact([stamped(f"frame{i}", stamp) for i in range(rows)])
        reply = client.query("snapshot", wire.snapshot_request(None))
        plan = wire.parse_snapshot_plan(reply)
        assert len(plan.bounds) > 3
        assert plan.settings.cache_ns == 10**10
        # A range that is too large is cut short.
        request = wire.SnapshotRequest(reply["instance"], 0, 0, int(plan.bounds[-1]))
        answer = client.query("snapshot", wire.snapshot_request(request))
        piece = wire.parse_snapshot_piece(answer)
        assert 0 < piece.reached < plan.bounds[-1]
        tree = TransformTree()
        snapshot(client, tree, ChangeReplay(tree))
        assert tree.frames() == tf.frames()
        assert tree.stats()["samples"] == rows * 20


@pytest.mark.parametrize(
    ("request_type", "body", "field"),
    [
        ("snapshot", {"v": 1, "piece": 0}, "after"),
        ("snapshot", {"v": 1, "piece": 0, "after": 0, "until": -1}, "until"),
        ("snapshot", {"v": 1, "piece": 0, "after": 0, "until": 1 << 40}, "until"),
        ("snapshot", {"v": 1, "piece": 0, "after": 0, "until": 1}, "instance"),
        ("missed", {"v": 1, "instance": "x"}, "first"),
        ("missed", {"v": 1, "first": 1}, "instance"),
    ],
)
def test_malformed_requests(
    server: ServerProcess, request_type: str, body: dict[str, Any], field: str
) -> None:
    with raw(server.endpoint) as client:
        error = client.error(request_type, body)
        assert isinstance(error, ProtocolError)
        assert error.field == field


def test_a_piece_that_is_too_large_for_a_reply(start_server: StartServer) -> None:
    server = start_server("--limit", "reply_bytes=3000")
    with server.connect() as tf, raw(server.endpoint) as client:
        for i in range(100):
            tf.set_transform(stamped(f"frame{i}", 1))
        reply = client.query("snapshot", wire.snapshot_request(None))
        request = wire.SnapshotRequest(reply["instance"], 0, 0, 200)
        error = client.error("snapshot", wire.snapshot_request(request))
        assert isinstance(error, LimitExceeded)
        assert error.field == "reply_bytes"
