"""Lookups that wait for a transform, without holding a worker or a thread.

The native tree parks a lookup on the frames that it waits for, and a commit to one of them wakes
it. One thread retries the lookups that were woken and replies to those that are done. Deadlines
are timers of the asyncio loop. A lookup costs nothing while it waits.

Thread safety: all methods.
Invariant: `_take` returns each waiting lookup to one caller only, which settles or fails it.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import ParkedLookups, WakeQueue, park_lookups
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable, TransformException

from .limits import Limits

if TYPE_CHECKING:
    from zenoh_tf._core import Rows

log = logging.getLogger("zenoh_tf.server")

_JOIN_TIMEOUT_S = 1.0


class _Request:
    """Lookups of one request, which share a reply: settled or failed exactly once."""

    def __init__(
        self,
        count: int,
        settle: Callable[[list[Rows]], None],
        fail: Callable[[TransformException], None],
    ) -> None:
        self._results: list[Rows | None] = [None] * count
        self._left = count
        self._settle = settle
        self._fail = fail
        self._lock = threading.Lock()

    def settle(self, index: int, rows: Rows) -> None:
        with self._lock:
            self._results[index] = rows
            self._left -= 1
            last = self._left == 0
        if last:
            self._settle([result for result in self._results if result is not None])

    def fail(self, error: TransformException) -> None:
        with self._lock:
            first, self._left = self._left > 0, -1
        if first:
            self._fail(error)


@dataclass(slots=True, eq=False)
class _Waiting:
    rows: ParkedLookups
    lookup: wire.Lookup
    index: int  # in its request
    request: _Request
    since_s: float
    timer: asyncio.TimerHandle | None = None


class Waiters:
    def __init__(
        self, tree: TransformTree, limits: Limits, loop: asyncio.AbstractEventLoop
    ) -> None:
        self._tree = tree
        self._limits = limits
        self._loop = loop
        self._queue = WakeQueue()
        self._tokens = itertools.count()
        self._lock = threading.Lock()
        self._waiting: dict[int, _Waiting] = {}  # by token
        self._rows = 0  # of all waiting lookups
        self._stopping = False
        self._thread = threading.Thread(target=self._serve, name="waiters", daemon=True)
        self._thread.start()

    def ask(
        self,
        lookups: Sequence[wire.Lookup],
        settle: Callable[[list[Rows]], None],
        fail: Callable[[TransformException], None],
    ) -> None:
        """Start waiting. Calls `settle` with the results of all lookups, from any thread, or
        `fail` if the server stops first.

        A lookup is done when each of its rows has an answer or can never have one, at its
        deadline at the latest. Each row is a transaction of its own.

        Raises:
            LimitExceeded: Too many lookups wait.
            ServerUnavailable: The server is stopping.
        """
        request = _Request(len(lookups), settle, fail)
        now_s = time.monotonic()
        started = {}
        for index, lookup in enumerate(lookups):
            token = next(self._tokens)
            rows = self._rows_of(lookup, token)
            started[token] = _Waiting(rows, lookup, index, request, now_s)
        with self._lock:
            if self._stopping:
                raise ServerUnavailable("the server is stopping")
            count = self._rows + sum(lookup.rows for lookup in lookups)
            self._limits.check("waiters", count)
            self._rows = count
            self._waiting |= started
        for token, waiting in started.items():
            if waiting.rows.start():
                self._finish(token)
            else:
                timeout_s = waiting.lookup.timeout_ns * 1e-9
                self._loop.call_soon_threadsafe(self._start_timer, token, timeout_s)

    def close(self) -> None:
        """Fail all waiting lookups with ServerUnavailable, and end the thread."""
        with self._lock:
            self._stopping = True
            tokens = list(self._waiting)
        self._queue.close()
        for token in tokens:
            if waiting := self._take(token):
                waiting.request.fail(ServerUnavailable("the server is stopping"))
        self._thread.join(_JOIN_TIMEOUT_S)

    def _rows_of(self, lookup: wire.Lookup, token: int) -> ParkedLookups:
        if lookup.atomic or lookup.versions:
            raise InvalidArgumentException(
                "a lookup with `atomic` or `versions` cannot wait: leave out timeout_ns",
                field="timeout_ns",
            )
        return park_lookups(
            self._tree,
            self._queue,
            token,
            lookup.names,
            lookup.op,
            lookup.target,
            lookup.source,
            lookup.stamp,
            lookup.fixed,
            lookup.source_stamp,
        )

    def _serve(self) -> None:
        while (tokens := self._queue.take()) is not None:
            for token in tokens:
                self._finish(token)

    def _take(self, token: int) -> _Waiting | None:
        """Remove a waiting lookup. None: another caller has taken it."""
        with self._lock:
            waiting = self._waiting.pop(token, None)
            if waiting is None:
                return None
            self._rows -= waiting.lookup.rows
        waiting.rows.cancel()
        if waiting.timer is not None:
            self._loop.call_soon_threadsafe(waiting.timer.cancel)
        return waiting

    def _finish(self, token: int) -> None:
        if waiting := self._take(token):
            try:
                rows = waiting.rows.result(time.monotonic() - waiting.since_s)
                waiting.request.settle(waiting.index, rows)
            except Exception:  # no lookup may end the thread
                log.exception("internal error while replying to a lookup that has waited")

    def _start_timer(self, token: int, timeout_s: float) -> None:
        if waiting := self._waiting.get(token):
            waiting.timer = self._loop.call_later(timeout_s, self._finish, token)
