"""Lookups that wait at the server, where a cancelled one is cancelled.

The server would let a cancelled lookup wait until its time-out, and count it.
"""

from __future__ import annotations

import itertools
from typing import Any, Final, TypeVar

from zenoh_tf import wire
from zenoh_tf.steps import LoopSteps

from ...requests import info
from ...requests.request import Request
from ...session.exchange import Exchange
from .transport import Transport

T = TypeVar("T")

#: A cancellation may overtake its lookup. It is repeated after pauses that double up to the last;
#: a server that is busy for longer lets the lookup wait until its time-out.
_FIRST_PAUSE_S: Final = 0.05
_LAST_PAUSE_S: Final = 2.0


class Wait(Request[T]):
    """A request whose lookups wait, with a name to cancel them by."""

    def __init__(self, request: Request[T], wait_id: int) -> None:
        self._request = request
        self.request_type = request.request_type
        self.wait_s = request.wait_s
        self.writes = request.writes
        self.wait_id = wait_id

    def body(self) -> wire.Message:
        return self._request.body() | {"wait_id": self.wait_id}

    def parse(self, reply: wire.Message) -> T:
        return self._request.parse(reply)


class Waits:
    """Names waiting lookups, and cancels them. Thread safety: the loop's thread."""

    def __init__(self, transport: Transport, exchange: Exchange) -> None:
        self._transport = transport
        self._exchange = exchange
        self._ids = itertools.count()
        self._cancelled: list[int] = []

    def named(self, request: Request[T]) -> Wait[T]:
        """The same request with a name."""
        return Wait(request, next(self._ids))

    def cancel(self, wait: Wait[Any]) -> None:
        """Let the server forget a lookup at the end of this turn, with the others of this turn."""
        if not self._cancelled:
            self._transport.loop.call_soon(self._send)
        self._cancelled.append(wait.wait_id)

    def _send(self) -> None:
        wait_ids, self._cancelled = self._cancelled, []
        _Cancellation(self._transport, self._exchange, wait_ids, _FIRST_PAUSE_S).start()


class _Cancellation(LoopSteps):
    """Cancels lookups at the server; repeats it for those that did not wait there yet."""

    __slots__ = ("_exchange", "_pause_s", "_transport")

    def __init__(
        self, transport: Transport, exchange: Exchange, wait_ids: list[int], pause_s: float
    ) -> None:
        super().__init__(transport, exchange.steps(info.cancel(wait_ids)))
        self._transport = transport
        self._exchange = exchange
        self._pause_s = pause_s

    def start(self) -> None:
        if not self._transport.is_closed:  # or the server learns that the client is gone
            super().start()

    def _done(self, result: list[int], error: Exception | None) -> None:
        # A server without this request, or that is gone, needs no second message.
        if error is None and result and self._pause_s <= _LAST_PAUSE_S:
            again = _Cancellation(self._transport, self._exchange, result, 2 * self._pause_s)
            self._transport.loop.call_later(self._pause_s, again.start)
