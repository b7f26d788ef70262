"""The feed of a mirror against a simulated server: what goes wrong at its owner ends nothing."""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import zenoh

from tests.conftest import linux
from tests.support.waiting import wait_until
from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ChangeLog
from zenoh_tf._net import keys
from zenoh_tf.errors import ProtocolError, ServerUnavailable
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.mirrors.own_threads import OwnThreads
from zenoh_tf.mirrors.source import ServerStatus
from zenoh_tf.steps import Ask, Pause, Steps
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.process.sharing import SharingSettings
from zenoh_tf_server.process.upstream import Upstream
from zenoh_tf_server.replica.copies import SharedCopies

SETTINGS = wire.TreeSettings(10**9, 10, 10, 255, 10)


class Server:
    """A `Source` whose tree is empty, and which says each 10 ms that it is there."""

    tree = "main"
    calls = contextlib.nullcontext()

    def __init__(self) -> None:
        self._log = ChangeLog(TransformTree(max_log_bytes=1 << 20))
        self._log.start()
        self._ended = threading.Event()

    def subscribe(self, channel: object) -> Any:
        return SimpleNamespace(handler=self)

    def unsubscribe(self, subscriber: object) -> bool:
        self._ended.set()
        return True

    def recv(self) -> Any:
        if self._ended.wait(0.01):
            raise zenoh.ZError("undeclared")
        message = wire.StreamMessage("i", 1, 0, time.monotonic_ns())
        data = wire.pack(wire.stream_body(message))
        payload = SimpleNamespace(to_bytes=lambda: data)
        return SimpleNamespace(payload=payload, key_expr=keys.stream(self.tree, "i"))

    def try_recv(self) -> None:
        return None

    def ask(self, request_type: str, body: wire.Message, wait_s: float) -> Steps[wire.Message]:
        yield from ()
        if "piece" in body:
            reached, frames = self._log.read_snapshot(0, 1, 1000)
            fields = wire.snapshot_piece_reply(wire.SnapshotPiece(0, reached, 0, frames))
        else:
            bounds = np.array([0, 1], np.uint32)
            plan = wire.SnapshotPlan(0, False, bounds, SETTINGS, time.monotonic_ns())
            fields = wire.snapshot_plan_reply(plan)
        return wire.unpack(wire.pack({"v": wire.VERSION, "instance": "i", **fields}))

    def status(self) -> Steps[ServerStatus]:
        status: ServerStatus = yield Ask(zenoh.KeyExpr("hello"), b"", 1.0)
        return status

    def take(self, step: Ask | Pause) -> ServerStatus:
        return ServerStatus("i", time.monotonic_ns(), 0)


def test_an_owner_that_cannot_take_a_copy_gets_another(caplog: pytest.LogCaptureFixture) -> None:
    received: list[TransformTree | None] = []

    def on_copy(tree: TransformTree | None, instance: str) -> None:
        received.append(tree)
        if len(received) <= 2:
            raise OSError("no room")

    feed = MirrorFeed(Server(), on_copy)
    try:
        feed.wait_for_copy(10)
        assert feed.state.tree is received[2]
        assert len(set(map(id, received))) == len(received) == feed.snapshots == 3
        wait_until(lambda: feed.state.synced, "it does not continue")
        assert [record.exc_text is not None for record in caplog.records] == [True, True]
    finally:
        feed.close()
    assert received[3:] == [None]


class AtOnce(OwnThreads):
    """Takes all steps of the checks for another server before `run` returns, as a thread may that
    began at once while its starter had to wait for a processor. It takes no time for pauses."""

    def __init__(self, outcomes: list[str | Exception | None]) -> None:
        """`outcomes`: of each check: the instance that answers, an error, or no thread."""
        self._outcomes = outcomes
        self.checks = 0

    def run(self, feed: MirrorFeed, steps: Steps[None]) -> bool:
        if getattr(steps, "gi_code").co_name != "_check_server":  # noqa: B009
            return super().run(feed, steps)
        outcome = self._outcomes[min(self.checks, len(self._outcomes) - 1)]
        self.checks += 1
        if outcome is None:
            return False
        with contextlib.suppress(StopIteration, OSError):
            next(steps)
            if isinstance(outcome, Exception):
                steps.throw(outcome)
            else:
                steps.send(ServerStatus(outcome, time.monotonic_ns(), 0))
            steps.send(False)
        return True


@pytest.mark.parametrize(
    "first",
    ["i", ServerUnavailable("away"), OSError("broken"), None],
    ids=["another's message", "no reply", "an error", "no thread"],
)
def test_a_check_that_ends_at_once_is_followed_by_others(first: str | Exception | None) -> None:
    """The flag that a check is under way stayed set, and the mirror followed a server that had
    gone for ever."""
    runner = AtOnce([first, "j"])
    feed = MirrorFeed(Server(), lambda tree, instance: None, runner=runner)
    try:
        feed.wait_for_copy(10)
        assert feed.snapshots == 1
        message = wire.StreamMessage("j", 1, 0, time.monotonic_ns())
        payload = SimpleNamespace(to_bytes=lambda: wire.pack(wire.stream_body(message)))
        sample = SimpleNamespace(payload=payload, key_expr=keys.stream("main", "j"))
        for checks in (1, 2):
            feed.take([cast(Any, sample)])
            assert runner.checks == checks
        wait_until(lambda: feed.snapshots == 2, "it does not look for the other server")
    finally:
        feed.close()


@pytest.mark.parametrize("value", [{}, {"value": 3}, {"value": {}}])
def test_a_malformed_hello_of_a_primary(value: wire.Message) -> None:
    primary: Any = Upstream.__new__(Upstream)
    primary.tree, primary._user, primary._own_id = "main", None, "1"
    steps = primary.status()
    assert wire.unpack(next(steps).payload)["what"] == "hello"
    with pytest.raises(ProtocolError):
        steps.send(wire.pack({"v": 1, "instance": "i", **value}))


@linux
def test_a_copy_whose_socket_was_removed_is_not_shared(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    copies = SharedCopies(SharingSettings(folder=tmp_path), "main")
    for is_removed in (True, False):
        tree = copies.make_tree(SETTINGS, "i")
        if is_removed:
            (path,) = tmp_path.glob("*.new")
            path.unlink()
        assert (copies.share(tree, Limits()) is None) == is_removed
        assert ("cannot share a copy" in caplog.text) == is_removed
        caplog.clear()
    copies.close()
    assert list(tmp_path.iterdir()) == []
