"""Feeds a mirror: listens to the stream of a tree's server, and asks for what is missing.

Mirrors of clients, replicas of servers and trees of robots share it; each adds a `Source`, which
listens and asks.

One thread receives the messages from Zenoh and applies them. Zenoh's threads only put them into a
ring, which drops its oldest messages when the thread falls behind: they are then asked for again.
Each request is a routine of its own while it is under way, so that the stream does not wait for it.
Another routine compares the clocks, and subscribes again if the stream is silent though the server
answers: a server sends ten heartbeats a second. A `Runner` has the threads: `own_threads` of a
mirror, or one thread for all robots of a site.

Thread safety: all methods. Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

import zenoh
from zenoh.handlers import RingChannel

from .. import threads, wire
from .._net.server_clock import COMPARISONS, ServerClock, now_ns
from ..errors import (
    LimitExceeded,
    ProtocolError,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    TimeoutException,
    TransformException,
)
from ..steps import Pause, Steps
from ..tree import TransformTree
from .copy import Observer
from .free_memory import give_back_soon
from .mirroring import MakeTree, Mirroring, MirrorRequest, make_tree
from .own_threads import OwnThreads
from .shared_bytes import SharedBytes
from .source import Runner, Source, State
from .stream_guard import Alarm, is_ahead, senders

log = logging.getLogger("zenoh_tf.mirror")

#: Messages between Zenoh and the thread. A server's message has 256 kB, or one commit.
_RING_MESSAGES: Final = 256
#: Messages, and bytes of them, that `poll` applies at once: feeds that share a thread take turns.
_POLL_MESSAGES: Final = 16
_POLL_BYTES: Final = 1 << 18
#: A request that failed is repeated after a pause, which doubles.
_FIRST_PAUSE_S: Final = 0.1
_LONGEST_PAUSE_S: Final = 0.5
#: The least time between the beginnings of two snapshots.
_SNAPSHOT_PERIOD_S: Final = 0.5
#: The mirror checks at this period whether the stream is silent.
_WATCH_PERIOD_S: Final = 1.0
_MAX_SILENT_PERIODS: Final = 2
#: The clocks are compared in each of the first periods, then now and then.
_CLOCK_PERIODS: Final = 10
#: The least time between two questions whether another server has come.
_CHECK_PERIOD_S: Final = 0.1
_JOIN_TIMEOUT_S: Final = 1.0
#: How much longer than a plan a part of a copy may take. Many mirrors of a busy machine wait for
#: each other's parts: if all gave up and asked again, none would ever get one in time.
_PART_WAIT_S: Final = 25.0
#: Errors of requests that may end by themselves, and none: then the first copy may still come.
_MAY_END: Final = (type(None), ServerBusy, ServerRestarted, ServerUnavailable, TimeoutException)


class MirrorFeed:
    """Keeps a `Mirroring` up to date, from construction to `close`."""

    def __init__(
        self,
        source: Source,
        on_copy: Callable[[TransformTree | None, str], None],
        interest: wire.Interest | None = None,
        make_tree: MakeTree = make_tree,
        observer: Observer | None = None,
        *,
        keeps_tree: bool = True,
        runner: Runner | None = None,
        room: SharedBytes | None = None,
    ) -> None:
        """Begin to listen. Calls `on_copy` with each new copy of the tree and its instance, before
        `state` has it, and with None at the end.

        Raises ServerUnavailable if the connection is closed.
        """
        self.source = source
        self._runner: Runner = runner or OwnThreads()
        self._on_copy = on_copy
        #: Called after each change and at the end, under the lock. Must not wait.
        self.on_change: Callable[[], object] = lambda: None
        #: Read without the lock, which is held while changes are applied.
        self.state = State()
        self.clock = ServerClock()
        #: Others only read it.
        self.mirroring = Mirroring(
            make_tree, interest, observer, keeps_tree=keeps_tree, room=room, clock=self.clock
        )
        self._interest = interest
        self._changed = threading.Condition()  # guards all but `state`
        #: It listens no more, as it or the connection was closed.
        self.closed = False
        self._ended = threading.Event()
        self._error: TransformException | None = None  # of the last request
        self._refused: TransformTree | None = None  # the last copy, if `on_copy` has raised
        self._pauses = threads.pauses(_FIRST_PAUSE_S, _LONGEST_PAUSE_S)  # since the last copy
        self._next_snapshot_s = 0.0
        self._has_warned = False
        self._alarm = Alarm(source.tree)
        self._is_checking = False  # a routine asks who the server is
        self._sender = senders(source.tree, interest.id if interest else "")
        #: Grows with the messages that have come. Written by the listening thread alone.
        self.heard = 0
        self.silent_at = -1  #: What `heard` was when nothing had come for seconds.
        self._credit = 0  # bytes that `poll` may apply now
        self._is_applying = False  # written by the listening thread alone
        #: Another one once the stream was silent.
        self.subscriber = source.subscribe(RingChannel(_RING_MESSAGES))
        self._thread = self._runner.listen(self)
        self._runner.run(self, self._watch())

    # --- what the mirror reads

    @property
    def snapshots(self) -> int:
        """How many snapshots were begun."""
        return self.mirroring.snapshots

    def age_s(self, state: State | None = None) -> float:
        """How old the copy, or what it was in a state, is at most; infinite before there is one."""
        state = state or self.state
        return self.clock.age_s(state.instance, state.clock_ns)

    def wait(self, is_reached: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until `is_reached()`, which runs after each change and under the lock, is true.
        False after `timeout_s`, or at the end."""
        with self._changed:
            self._changed.wait_for(lambda: is_reached() or self.closed, timeout_s)
            return is_reached()

    def wait_for_copy(self, timeout_s: float) -> None:
        """Wait for the first copy.

        Raises:
            ServerUnavailable: No server answered, or it offers no mirrors, or the client is closed.
            AccessDenied: The server's access rules do not allow to read.
            TimeoutException: The snapshot was not complete in time.
            LimitExceeded: A frame's history has no room in a reply of the server.
        """
        self.wait(lambda: bool(self.state.tree) or not isinstance(self._error, _MAY_END), timeout_s)
        if self.state.tree is not None:
            return
        if self._error is not None:
            raise self._error
        if self.closed:
            raise ServerUnavailable("the connection is closed")
        raise TimeoutException(f"the snapshot was not complete within {timeout_s:g} s")

    def paused(self) -> AbstractContextManager[object]:
        """While it is entered, nothing is applied. Must not last."""
        return self._changed

    def connection_changed(self) -> None:
        """Listen in the connection's new session, where messages may come once more."""
        if self.closed:
            return
        with self._changed:
            self.mirroring.connection_changed()
        self._subscribe_again()

    def close(self) -> None:
        """Listen no more. May be called again."""
        if not self.source.unsubscribe(self.subscriber):
            return
        self.closed = True
        if threading.current_thread() is not self._thread:
            self._ended.wait(_JOIN_TIMEOUT_S)

    # --- what the runner calls

    def wait_for_end(self, timeout_s: float) -> bool:
        """Wait until the feed has ended. False: it has not in time."""
        return self._ended.wait(timeout_s)

    def poll(self) -> bool:
        """Apply messages that have come, without waiting for others. False: the feed has ended.
        Thread safety: one thread."""
        subscriber = self.subscriber
        batch: list[zenoh.Sample] = []
        # A feed that takes more in one message than it may waits in as many turns.
        self._credit = min(self._credit, 0) + _POLL_BYTES
        try:
            receive = subscriber.handler.try_recv
            while len(batch) < _POLL_MESSAGES and self._credit > 0 and (sample := receive()):
                batch.append(sample)
                self._credit -= len(sample.payload)
        except (zenoh.ZError, RuntimeError):  # undeclared, or another thread does that now
            self.closed = self.closed or subscriber is self.subscriber
        if batch:
            self.take(batch)
        if self.closed:
            self.end()
        return not self.closed

    def take(self, batch: list[zenoh.Sample]) -> None:
        """Apply messages."""
        self.heard += len(batch)
        self._is_applying = True
        for sample in batch:
            instance = self._sender(str(sample.key_expr))
            if instance is not None:
                self._received(instance, sample.payload.to_bytes())
        self._is_applying = False

    # --- the stream

    def _watch(self) -> Steps[None]:
        """Compare the clocks now and then, and subscribe again if the stream is silent."""
        yield from self._compare_clocks()
        with self._changed:
            self._proceed()
        silent = heard = 0
        for period in itertools.count():
            if (yield Pause(_WATCH_PERIOD_S)):
                return
            silent = silent + 1 if self.heard == heard and not self._is_applying else 0
            heard = self.heard
            if self._interest and silent and (yield from self._compare_clocks()):
                self._restart()  # the server was restarted, or has ended the interest
            if silent >= _MAX_SILENT_PERIODS:
                self.silent_at = heard
                if (yield from self._compare_clocks()):
                    log.info("the stream of tree %r is silent: subscribing again", self.source.tree)
                    self._subscribe_again()
                    silent = 0
            elif period < COMPARISONS or period % _CLOCK_PERIODS == 0:
                yield from self._compare_clocks()

    def _restart(self) -> None:
        with self._changed:
            if self.state.synced:  # else a request is under way, or waits
                self.mirroring.restart()
                self._proceed()

    def _subscribe_again(self) -> None:
        old = self.subscriber
        with contextlib.suppress(ServerUnavailable, zenoh.ZError):
            self.subscriber = self.source.subscribe(RingChannel(_RING_MESSAGES))
            self.source.unsubscribe(old)  # now that the thread finds the other one
            if self.closed:  # meanwhile
                self.close()

    def _received(self, sender: str, data: bytes) -> None:
        with self._changed:
            if self.mirroring.followed not in ("", sender):
                if not self._is_checking:  # it may be a new server, or anybody's
                    self._is_checking = True  # the routine may end before `run` returns
                    if not self._runner.run(self, self._check_server()):
                        self._is_checking = False
                return
            try:
                self.mirroring.received(data, sender)
            except (LimitExceeded, ProtocolError) as error:  # what follows it is a gap
                level = logging.DEBUG if self._has_warned else logging.WARNING
                self._has_warned = True
                log.log(level, "a message of the commit stream is malformed: %s", error)
            except Exception:
                log.exception("internal error while a mirror applied a message; it restarts")
                self.mirroring.restart()
            self._proceed()

    def _proceed(self) -> None:
        """Send requests, and report what has changed. Requires the lock."""
        if self.closed:
            return
        m = self.mirroring
        if m.contradictions:
            self._alarm.record(m.contradictions)
        has_copy = self._accept_copy()
        for request in m.take_requests():
            if not self._runner.run(self, self._ask(request)):
                m.failed(request.number)  # the next message sends it again
        if has_copy:
            self.state = m.state
            self._changed.notify_all()
            self.on_change()

    def _accept_copy(self) -> bool:
        """Report a new copy. False: the owner has rejected it, and the next one comes."""
        tree = self.mirroring.tree
        if tree is not self.state.tree and tree is not self._refused:
            self._pauses = threads.pauses(_FIRST_PAUSE_S, _LONGEST_PAUSE_S)
            self._error = self._refused = None
            try:
                self._on_copy(tree, self.mirroring.state.instance)
            except Exception:  # the thread must not end: nobody else would make a copy
                log.exception("internal error while a new copy was loaded; it is loaded again")
                self._refused = tree
                self.mirroring.restart()  # its request waits for its turn
            if tree is not None and self.state.tree is not None:
                self._runner.run(self, give_back_soon())
        return tree is not self._refused or tree is None

    def end(self) -> None:
        """There are no more messages: the feed or its connection is closed."""
        with self._changed:
            self.closed = True
            self.state = State()
            self.mirroring.restart()  # nothing waits any more
            self._on_copy(None, "")
            self._changed.notify_all()
            self.on_change()
        self._ended.set()

    # --- requests, each a routine of its own

    def _ask(self, request: MirrorRequest) -> Steps[None]:
        """Send a request, and apply its reply."""
        is_plan = request.request_type == "snapshot" and "piece" not in request.body
        if is_plan and not (yield from self._wait_for_turn(request)):
            return
        begin_ns = now_ns()
        try:
            wait_s = 0.0 if is_plan else _PART_WAIT_S
            reply = yield from self.source.ask(request.request_type, dict(request.body), wait_s)
            if is_plan:
                if self._interest is not None and "changes" not in reply:
                    raise ServerUnavailable("the server knows no interests")
                instance, clock_ns = wire.text(reply, "instance"), wire.integer(reply, "clock_ns")
                self.clock.compared(instance, begin_ns, clock_ns)
        except Exception as error:
            yield from self._fail(request, error)
            return
        with self._changed:
            try:
                self.mirroring.answered(request.number, reply)
            except Exception:
                log.exception("internal error while a mirror took a reply; it restarts")
                self.mirroring.restart()
            self._proceed()

    def _wait_for_turn(self, request: MirrorRequest) -> Steps[bool]:
        """Wait until the next snapshot may begin. False: this one is of no use any more."""
        while True:
            with self._changed:
                if self.closed or not self.mirroring.awaits(request.number):
                    return False
                pause_s = self._next_snapshot_s - time.monotonic()
                if pause_s <= 0:
                    self._next_snapshot_s = time.monotonic() + _SNAPSHOT_PERIOD_S
                    return True
            yield Pause(pause_s)

    def _fail(self, request: MirrorRequest, error: Exception) -> Steps[None]:
        """Record why a request failed. After a pause it is sent again."""
        if not isinstance(error, TransformException):
            log.error("internal error while a mirror sent a request", exc_info=error)
            error = ServerUnavailable(str(error))
        with self._changed:
            self._error = error
            self._changed.notify_all()
            pause_s = next(self._pauses)
        if not (yield Pause(pause_s)):
            with self._changed:
                self.mirroring.failed(request.number, error)
                self._proceed()

    # --- clocks

    def _compare_clocks(self) -> Steps[bool]:
        """Compare this machine's clock with the server's. False: it does not answer."""
        state, begin_ns = self.state, now_ns()
        try:
            server = yield from self.source.status()
        except TransformException:
            return False
        self.clock.compared(server.instance, begin_ns, server.clock_ns, server.real_ns)
        if is_ahead(state, server):
            with self._changed:
                if self.state.tree is state.tree:
                    self.mirroring.contradicted()
                    self._proceed()
        return True

    def _check_server(self) -> Steps[None]:
        """Follow the server that answers now, if it is another one."""
        instance = ""
        try:
            with contextlib.suppress(TransformException):
                instance = (yield from self.source.status()).instance
            yield Pause(_CHECK_PERIOD_S)
        finally:  # after any other error, too: the next message checks again
            with self._changed:
                self._is_checking = False
                if instance and self.mirroring.followed not in ("", instance):
                    self.mirroring.restart()
                    self._proceed()
