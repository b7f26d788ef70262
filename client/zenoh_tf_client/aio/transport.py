"""Sends queries from an event loop, and hands their replies over to it.

Zenoh calls back on its own threads, which must not be held up. All replies that arrive until the
loop runs wake it once.

Thread safety: the loop's thread, except where it says more.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from zenoh_tf.errors import ServerUnavailable, TransformException

from ..exchange import Ask
from ..queries import Queries, ReplyParts
from .threads import Worker
from .wake import Wake
from .zenoh_threads import keep_thread_state

#: Messages beyond this many unanswered bytes are sent by a thread: Zenoh blocks its caller once its
#: own queue and the socket's are full, as happens with a server that was stopped. These queues hold
#: more than that.
_DIRECT_BYTES: Final = 1 << 16

#: The payload of a reply, None for a query that ended without one, or why it was not sent.
Outcome = bytes | TransformException | None
#: What arrives: a reply or a part of one, None for the end, or why the query was not sent.
_Arrival = zenoh.Reply | TransformException | None


class Transport:
    """The queries of one loop in one session."""

    def __init__(self, loop: asyncio.AbstractEventLoop, queries: Queries) -> None:
        self.loop = loop
        self.queries = queries
        #: For calls that may block.
        self.worker = Worker()
        self.is_closed = False
        self._unanswered_bytes = 0
        self._arrivals: deque[tuple[SentQuery, _Arrival]] = deque()
        self._wake = Wake(loop, self._take)

    def send(self, step: Ask, arrived: Callable[[Outcome], None]) -> SentQuery:
        """Send a query. The loop calls `arrived` with its outcome, unless it is cancelled."""
        query = SentQuery(self, step, arrived)
        self._unanswered_bytes += len(step.payload)
        if self.is_closed:
            error = ServerUnavailable("the connection is closed")
            self.loop.call_soon(query.take, error)
        elif self._unanswered_bytes <= _DIRECT_BYTES:
            query.send()
        else:
            self.worker.start(query.send)
        return query

    def close(self) -> None:
        """Send and receive nothing any more. May be called again."""
        if not self.is_closed:
            self.is_closed = True
            self._wake.close()

    def hand_over(self, query: SentQuery, arrival: _Arrival) -> None:
        """Let the loop take what has arrived. Thread safety: any thread."""
        self._arrivals.append((query, arrival))
        self._wake.send()

    def note_end(self, step: Ask) -> None:
        """A query is answered or cancelled."""
        self._unanswered_bytes -= len(step.payload)

    def _take(self) -> None:
        arrivals = self._arrivals
        while arrivals:
            query, arrival = arrivals.popleft()
            query.take(arrival)


class SentQuery:
    """A query without an outcome yet. Zenoh calls `_replied` and `_ended`."""

    __slots__ = ("_arrived", "_parts", "_step", "_token", "_transport")

    def __init__(self, transport: Transport, step: Ask, arrived: Callable[[Outcome], None]) -> None:
        self._transport = transport
        self._step = step
        self._arrived: Callable[[Outcome], None] | None = arrived  # None: nobody wants it any more
        self._parts = ReplyParts()
        self._token = zenoh.CancellationToken()

    def send(self) -> None:
        """Send it; may block. Thread safety: any thread."""
        step = self._step
        try:
            self._transport.queries.send(
                step.key, step.payload, step.timeout_s, self._replied, self._ended, self._token
            )
        except TransformException as error:
            self._transport.hand_over(self, error)

    def cancel(self) -> None:
        """Let Zenoh forget the query."""
        if self._arrived is not None:
            self._arrived = None
            self._transport.note_end(self._step)
            self._token.cancel()

    def take(self, arrival: _Arrival) -> None:
        """Report the outcome, if `arrival` completes it."""
        arrived = self._arrived
        if arrived is None:
            return
        outcome: Outcome
        if isinstance(arrival, zenoh.Reply):
            outcome = self._parts.add(arrival)
            if outcome is None:
                return
        else:
            outcome = arrival
        self._arrived = None
        self._transport.note_end(self._step)
        arrived(outcome)

    def _replied(self, reply: zenoh.Reply) -> None:
        keep_thread_state()
        self._transport.hand_over(self, reply)

    def _ended(self) -> None:
        if self._arrived is not None:
            self._transport.hand_over(self, None)
