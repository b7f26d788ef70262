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

from zenoh_tf._net.queries import ZENOH_TIMEOUT, ReplyParts
from zenoh_tf._zenoh.thread_states import keep_thread_state
from zenoh_tf.errors import ServerUnavailable, TransformException
from zenoh_tf.steps import Ask, Outcome

from ...session.connection import Connection
from .threads import Worker
from .wake import Wake

#: A thread sends what is more than this beyond what the server is known to have received. Zenoh
#: blocks its caller when its own queue and the sockets' are full, as happens with a server that was
#: stopped. They hold more than that.
_DIRECT_BYTES: Final = 1 << 16

#: What arrives: a reply or a part of one, None for a query that ended without one, or why it was
#: not sent.
_Arrival = zenoh.Reply | TransformException | None


class Transport:
    """The queries of one loop in one session."""

    def __init__(self, loop: asyncio.AbstractEventLoop, opened: Connection) -> None:
        self.loop = loop
        self.opened = opened
        #: For calls that may block.
        self.worker = Worker()
        self.is_closed = False
        self._sent_bytes = 0  # by all queries so far
        self._received_bytes = 0  # of them: up to the latest query that the server has answered
        self._arrivals: deque[tuple[SentQuery, _Arrival]] = deque()
        self._wake = Wake(loop, self._deliver)

    def send(self, step: Ask, arrived: Callable[[Outcome], None]) -> SentQuery:
        """Send a query. The loop calls `arrived` with its outcome, unless it is cancelled."""
        self._sent_bytes += len(step.payload)
        query = SentQuery(self, step, arrived, self._sent_bytes)
        if self.is_closed:
            error = ServerUnavailable("the connection is closed")
            self.loop.call_soon(query.accept, error)
        elif self._sent_bytes - self._received_bytes <= _DIRECT_BYTES and not self.worker.is_busy:
            query.send()
        else:
            # Zenoh's own time-out begins when it accepts the query.
            query.timer = self.loop.call_later(step.timeout_s, query.time_out)
            self.worker.start(query.send)
        return query

    def close(self) -> None:
        """Send and receive nothing any more. May be called again."""
        if not self.is_closed:
            self.is_closed = True
            self._wake.close()

    def hand_over(self, query: SentQuery, arrival: _Arrival) -> None:
        """Let the loop receive what has arrived. Thread safety: any thread."""
        self._arrivals.append((query, arrival))
        self._wake.send()

    def record_answer(self, sent_bytes: int) -> None:
        """The server has received all queries up to this many bytes."""
        self._received_bytes = max(self._received_bytes, sent_bytes)

    def _deliver(self) -> None:
        arrivals = self._arrivals
        while arrivals:
            query, arrival = arrivals.popleft()
            query.accept(arrival)


class SentQuery:
    """A query without an outcome yet. Zenoh calls `_replied` and `_ended`."""

    __slots__ = (
        "_arrived",
        "_is_sent",
        "_parts",
        "_sent_bytes",
        "_step",
        "_token",
        "_transport",
        "timer",
    )

    def __init__(
        self,
        transport: Transport,
        step: Ask,
        arrived: Callable[[Outcome], None],
        sent_bytes: int,
    ) -> None:
        """`sent_bytes`: of this query and all before it."""
        self._transport = transport
        self._step = step
        self._arrived: Callable[[Outcome], None] | None = arrived  # None: nobody wants it any more
        self._sent_bytes = sent_bytes
        self._is_sent = False
        self._parts = ReplyParts()
        self._token = zenoh.CancellationToken()
        self.timer: asyncio.TimerHandle | None = None

    def send(self) -> None:
        """Send it; may block. Thread safety: any thread."""
        step, opened = self._step, self._transport.opened
        queries = opened.queries
        try:
            queries.send(
                step.key, step.payload, step.timeout_s, self._replied, self._ended, self._token
            )
        except TransformException as error:
            self._transport.hand_over(self, None if opened.was_replaced(queries) else error)
        self._is_sent = True
        if self._arrived is None:  # it was cancelled meanwhile
            self._token.cancel()

    def cancel(self) -> None:
        """Let Zenoh forget the query."""
        if self._arrived is not None:
            self._finish()
            if self._is_sent:  # else to cancel it might block, too
                self._token.cancel()

    def time_out(self) -> None:
        """Report that no reply came in time."""
        arrived = self._arrived
        if arrived is not None:
            self.cancel()
            arrived(self._outcome(ZENOH_TIMEOUT))

    def accept(self, arrival: _Arrival) -> None:
        """Report the outcome, if `arrival` completes it."""
        arrived = self._arrived
        if arrived is None:
            return
        if isinstance(arrival, TransformException):
            self._finish()
            arrived(arrival)
            return
        data: bytes | None = None
        if arrival is not None:
            data = self._parts.add(arrival)
            if data is None:
                return
            if data != ZENOH_TIMEOUT:
                self._transport.record_answer(self._sent_bytes)
        self._finish()
        arrived(self._outcome(data))

    def _outcome(self, data: bytes | None) -> Outcome:
        return self._transport.opened.queries.outcome(data, self._step.timeout_s)

    def _finish(self) -> None:
        self._arrived = None
        if self.timer is not None:
            self.timer.cancel()

    def _replied(self, reply: zenoh.Reply) -> None:
        keep_thread_state()
        self._transport.hand_over(self, reply)

    def _ended(self) -> None:
        if self._arrived is not None:
            self._transport.hand_over(self, None)
