"""Sends queries from an event loop, and hands their replies over to it.

Zenoh calls back on its own threads. All replies that arrive until the loop runs wake it once.

Thread safety: one thread, that of the loop, but for what Zenoh calls.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import zenoh

from zenoh_tf.errors import ServerUnavailable, TransformException

from ..exchange import Ask
from ..queries import Queries, ReplyParts

#: Messages beyond this many unanswered bytes are sent by a thread: Zenoh blocks its caller once its
#: own queue and the socket's are full, as happens with a server that was stopped. These queues hold
#: more than that.
_DIRECT_BYTES: Final = 1 << 16

#: The payload of a reply, None for a query that ended without one, or why it was not sent.
Outcome = bytes | TransformException | None


class Transport:
    """The queries of one loop in one session."""

    def __init__(self, loop: asyncio.AbstractEventLoop, queries: Queries) -> None:
        self.loop = loop
        self.queries = queries
        self.executor = ThreadPoolExecutor(1, "zenoh-tf send")
        self.is_closed = False  # once True, no query is sent
        self._unanswered_bytes = 0
        # Between Zenoh's threads and the loop.
        self._arrived: deque[tuple[SentQuery, Outcome]] = deque()
        self._is_woken = False

    def send(self, step: Ask, arrived: Callable[[Outcome], None]) -> SentQuery:
        """Send a query. The loop calls `arrived` with its outcome, unless it is cancelled."""
        query = SentQuery(self, step, arrived)
        self._unanswered_bytes += len(step.payload)
        if self.is_closed:
            query.finish(ServerUnavailable("the connection is closed"))
        elif self._unanswered_bytes <= _DIRECT_BYTES:
            query.send()
        else:
            self.executor.submit(query.send)
        return query

    def hand_over(self, query: SentQuery, outcome: Outcome) -> None:
        """Let the loop take an outcome. Thread safety: any thread."""
        self._arrived.append((query, outcome))
        if not self._is_woken:
            self._is_woken = True
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits
                self.loop.call_soon_threadsafe(self._take)

    def forget(self, step: Ask) -> None:
        """A query has ended."""
        self._unanswered_bytes -= len(step.payload)

    def _take(self) -> None:
        self._is_woken = False  # first: what arrives from now on wakes the loop again
        while self._arrived:
            query, outcome = self._arrived.popleft()
            query.arrive(outcome)


class SentQuery:
    """A query without a reply yet. Zenoh calls `_replied` and `_ended`."""

    __slots__ = ("_arrived", "_is_over", "_parts", "_step", "_token", "_transport")

    def __init__(self, transport: Transport, step: Ask, arrived: Callable[[Outcome], None]) -> None:
        self._transport = transport
        self._step = step
        self._arrived: Callable[[Outcome], None] | None = arrived
        self._parts = ReplyParts()
        self._is_over = False
        self._token = zenoh.CancellationToken()

    def send(self) -> None:
        """Send it; may block. Thread safety: any thread."""
        step = self._step
        try:
            self._transport.queries.send(
                step.key, step.payload, step.timeout_s, self._replied, self._ended, self._token
            )
        except TransformException as error:
            self.finish(error)

    def arrive(self, outcome: Outcome) -> None:
        """Report the outcome, unless the query was cancelled."""
        arrived, self._arrived = self._arrived, None
        if arrived is not None:
            self._transport.forget(self._step)
            arrived(outcome)

    def cancel(self) -> None:
        """Let Zenoh forget the query."""
        if self._arrived is not None:
            self._arrived = None
            self._transport.forget(self._step)
            self._token.cancel()

    def _replied(self, reply: zenoh.Reply) -> None:
        if not self._is_over:
            data = self._parts.add(reply)
            if data is not None:
                self.finish(data)

    def _ended(self) -> None:
        self.finish(None)

    def finish(self, outcome: Outcome) -> None:
        """Hand the outcome over, unless there is one. Thread safety: any thread."""
        if not self._is_over:
            self._is_over = True
            self._transport.hand_over(self, outcome)
