"""Lookups that wait for a transform hold no worker and no thread.

The native tree parks them on the frames that they wait for, and the commit that may help
wakes them. One thread here asks again for whoever was woken and answers who is done;
deadlines run on the asyncio loop. Waiting costs nothing until one of the two happens.

Thread safety: all of it.
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
    """Lookups of one request, answered together: settled or failed once."""

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
        self._waiting: dict[int, _Waiting] = {}  # whoever takes one out settles it
        self._rows = 0  # of all of them
        self._stopping = False
        self._thread = threading.Thread(target=self._serve, name="waiters", daemon=True)
        self._thread.start()

    def ask(
        self,
        lookups: Sequence[wire.Lookup],
        settle: Callable[[list[Rows]], None],
        fail: Callable[[TransformException], None],
    ) -> None:
        """Settle, from any thread, with what every lookup found: each as soon as all of its
        rows have an answer or can have none, at its deadline at the latest. Each row is a
        transaction of its own. Fails where the server stops first."""
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
        """Fail whoever still waits with ServerUnavailable; end the thread."""
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
                "a lookup in one snapshot cannot wait", field="timeout_ns"
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
        """To exactly one caller, which then settles it."""
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
            except Exception:  # one lookup must never end the thread
                log.exception("while answering a lookup that has waited")

    def _start_timer(self, token: int, timeout_s: float) -> None:
        if waiting := self._waiting.get(token):
            waiting.timer = self._loop.call_later(timeout_s, self._finish, token)
