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
from typing import TYPE_CHECKING, Final

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._core import Budget, ParkedLookups, WakeQueue, park_lookups
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    ServerBusy,
    ServerUnavailable,
    TransformException,
)

from ..fair_share import FairShare
from ..limits import Limits
from .handler import UNKNOWN

if TYPE_CHECKING:
    from zenoh_tf._core import Rows

log = logging.getLogger("zenoh_tf.server")

_RETRY_AFTER_S: Final = 1.0
#: How long lookups of a client may wait that has no token, whose end would end them. A new
#: client's token may arrive after its first query: it asks again soon.
UNKNOWN_WAIT_S: Final = 10
_UNKNOWN_RETRY_S: Final = 0.05


class _WaitingRequest:
    """Lookups of one request, which share a reply: settled or failed exactly once."""

    def __init__(
        self,
        client: str,
        wait_id: int | None,
        budget: Budget,
        count: int,
        settle: Callable[[list[Rows]], None],
        fail: Callable[[Exception], None],
    ) -> None:
        self.client = client
        self.name = None if wait_id is None else (client, wait_id)
        self.lookup_ids: set[int] = set()  # of the lookups that still wait
        self.budget = budget
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

    def fail(self, error: Exception) -> None:
        """Does nothing if the request has failed before."""
        with self._lock:
            first, self._left = self._left >= 0, -1
        if first:
            self._fail(error)


@dataclass(slots=True, eq=False)
class _WaitingLookup:
    rows: ParkedLookups
    lookup: wire.Lookup
    links: int
    index: int  # in its request
    request: _WaitingRequest
    since_s: float
    timer: asyncio.TimerHandle | None = None


class Waiters:
    def __init__(
        self,
        tree: TransformTree,
        limits: Limits,
        loop: asyncio.AbstractEventLoop,
        is_connected: Callable[[str], bool],
    ) -> None:
        """`is_connected`: whether a client's token is there."""
        self._tree = tree
        self._limits = limits
        self._loop = loop
        self._is_connected = is_connected
        self._queue = WakeQueue()
        self._lookup_ids = itertools.count()
        self._lock = threading.Lock()
        # Guarded by the lock.
        self._waiting: dict[int, _WaitingLookup] = {}  # by their ids
        self._named: dict[tuple[str, int], _WaitingRequest] = {}  # those that may be cancelled
        self._rows = FairShare(limits, "waiters")
        self._links = FairShare(limits, "waiter_links")
        self._stopping = False
        self._thread = threads.start("waiters", self._serve)

    def ask(
        self,
        lookups: Sequence[wire.Lookup],
        client: str,
        budget: Budget,
        settle: Callable[[list[Rows]], None],
        fail: Callable[[Exception], None],
        wait_id: int | None = None,
    ) -> None:
        """Start waiting. Calls `settle` with the results of all lookups, from any thread, or
        `fail` if `settle` raises or the server stops first. The lookups end without a result that
        anyone sees when `client` is gone, or when it cancels `wait_id`.

        A lookup is done when each of its rows has an answer or can never have one, at its
        deadline at the latest. Each row is a transaction of its own.

        Raises:
            LimitExceeded: A time-out is too long, or the lookups never fit.
            ServerBusy: The client's share of waiting lookups is used up, or it has no token and
                wants to wait for longer than UNKNOWN_WAIT_S.
            ServerUnavailable: The server is stopping, or the client has gone.
        """
        for lookup in lookups:
            self._check(lookup, client)
        with self._lock:  # before anything is made for the rows
            self._rows.require_room(client, sum(lookup.rows for lookup in lookups), _RETRY_AFTER_S)
        request = _WaitingRequest(client, wait_id, budget, len(lookups), settle, fail)
        now_s = time.monotonic()
        started = {}
        for index, lookup in enumerate(lookups):
            lookup_id = next(self._lookup_ids)
            rows = self._rows_of(lookup, lookup_id)
            started[lookup_id] = _WaitingLookup(rows, lookup, rows.links(), index, request, now_s)
        self._add(request, started)
        for lookup_id, waiting in started.items():
            if waiting.rows.start():
                self._finish(lookup_id)
            else:
                timeout_s = waiting.lookup.timeout_ns * 1e-9
                self._loop.call_soon_threadsafe(self._start_timer, lookup_id, timeout_s)

    def cancel(self, client: str, wait_ids: Sequence[int]) -> list[int]:
        """End what the client waits for under these names. Returns those that do not wait: not
        any more, or not yet."""
        with self._lock:
            found = {wait_id: self._named.get((client, wait_id)) for wait_id in wait_ids}
            lookup_ids = [
                lookup_id
                for request in found.values()
                if request
                for lookup_id in request.lookup_ids
            ]
        self._fail(lookup_ids, "the lookup was cancelled")
        return [wait_id for wait_id, request in found.items() if request is None]

    def client_gone(self, client: str) -> None:
        """Drop what the client waits for. Returns at once, and works on a thread of its own."""
        with self._lock:
            lookup_ids = [
                lookup_id
                for lookup_id, waiting in self._waiting.items()
                if waiting.request.client == client
            ]
        if lookup_ids:
            threads.start("client-gone", self._fail, lookup_ids, "the client is gone")

    def close(self) -> None:
        """Fail all waiting lookups with ServerUnavailable, and end the thread."""
        with self._lock:
            self._stopping = True
            lookup_ids = list(self._waiting)
        self._queue.close()
        self._fail(lookup_ids, "the server is stopping")
        threads.join(self._thread)

    def _fail(self, lookup_ids: list[int], reason: str) -> None:
        with self._lock:
            ended = [waiting for lookup_id in lookup_ids if (waiting := self._take(lookup_id))]
        if not ended:
            return
        # In one call, as each wakes the loop's thread.
        self._loop.call_soon_threadsafe(_stop_timers, ended)
        error = ServerUnavailable(reason)
        for waiting in ended:
            waiting.rows.cancel()
            waiting.request.fail(error)

    def _check(self, lookup: wire.Lookup, client: str) -> None:
        if lookup.atomic or lookup.versions:
            raise InvalidArgumentException(
                "a lookup with `atomic` or `versions` cannot wait: leave out timeout_ns",
                field="timeout_ns",
            )
        longest_s = self._limits.wait_s
        if lookup.timeout_ns > longest_s * 1_000_000_000:
            timeout_s = lookup.timeout_ns * 1e-9
            raise LimitExceeded(
                f"the time-out is {timeout_s:g} s: the server lets a lookup wait for {longest_s} s "
                "at most",
                field="timeout_s",
                limit=longest_s,
                value=timeout_s,
            )
        if client == UNKNOWN and lookup.timeout_ns > UNKNOWN_WAIT_S * 1_000_000_000:
            raise ServerBusy(
                f"a lookup waits for more than {UNKNOWN_WAIT_S} s only for a client that is known "
                "to be there: by its liveliness token, whose id the query's attachment has "
                "(docs/reference/protocol.md)",
                field="timeout_s",
                limit=UNKNOWN_WAIT_S,
                value=lookup.timeout_ns * 1e-9,
                retry_after_s=_UNKNOWN_RETRY_S,
            )

    def _rows_of(self, lookup: wire.Lookup, lookup_id: int) -> ParkedLookups:
        return park_lookups(
            self._tree,
            self._queue,
            lookup_id,
            *lookup.columns,
            # The tree counts what the lookups watch in fact, also when frames move meanwhile.
            self._limits.waiter_links,
            lookup.max_gap_ns,
        )

    def _add(self, request: _WaitingRequest, started: dict[int, _WaitingLookup]) -> None:
        client = request.client
        rows = sum(waiting.lookup.rows for waiting in started.values())
        links = sum(waiting.links for waiting in started.values())
        with self._lock:
            if self._stopping:
                raise ServerUnavailable("the server is stopping")
            # A client that goes later finds the lookups: `client_gone` locks after that.
            if client != UNKNOWN and not self._is_connected(client):
                raise ServerUnavailable("the client has gone")
            self._rows.require_room(client, rows, _RETRY_AFTER_S)
            self._links.require_room(client, links, _RETRY_AFTER_S)
            self._rows.take_unchecked(client, rows)
            self._links.take_unchecked(client, links)
            self._waiting |= started
            request.lookup_ids.update(started)
            if request.name is not None:
                self._named[request.name] = request

    def _serve(self) -> None:
        while (lookup_ids := self._queue.take()) is not None:
            for lookup_id in lookup_ids:
                self._finish(lookup_id)

    def _take(self, lookup_id: int) -> _WaitingLookup | None:
        """Remove a waiting lookup; the caller cancels its rows and its timer. None: another caller
        has it. Requires the lock."""
        waiting = self._waiting.pop(lookup_id, None)
        if waiting is None:
            return None
        request = waiting.request
        request.lookup_ids.discard(lookup_id)
        if not request.lookup_ids and request.name and self._named.get(request.name) is request:
            del self._named[request.name]
        self._rows.give_back(request.client, waiting.lookup.rows)
        self._links.give_back(request.client, waiting.links)
        return waiting

    def _finish(self, lookup_id: int) -> None:
        """Reply to a lookup that has waited, if this was the last one of its request. Never raises:
        an error is the reply."""
        with self._lock:
            waiting = self._take(lookup_id)
        if waiting is None:
            return
        waiting.rows.cancel()
        if waiting.timer is not None:
            self._loop.call_soon_threadsafe(waiting.timer.cancel)
        try:
            rows = waiting.rows.result(
                time.monotonic() - waiting.since_s, waiting.lookup.errors, waiting.request.budget
            )
            waiting.request.settle(waiting.index, rows)
        except Exception as error:
            if not isinstance(error, TransformException):
                log.exception("internal error while replying to a lookup that has waited")
            waiting.request.fail(error)

    def _start_timer(self, lookup_id: int, timeout_s: float) -> None:
        with self._lock:  # `_take` sees the timer, or the lookup is gone and gets none
            if waiting := self._waiting.get(lookup_id):
                waiting.timer = self._loop.call_later(timeout_s, self._finish, lookup_id)


def _stop_timers(ended: Sequence[_WaitingLookup]) -> None:
    for waiting in ended:
        if waiting.timer is not None:
            waiting.timer.cancel()
