"""When a client sends a query again: the server is busy, or not there yet.

A query ends at once, without a reply, if nobody serves its key. That is so while no server runs,
and for a moment after a connection came back: the router is there again, but what it serves is not
declared yet (eclipse-zenoh/zenoh#2767), as its server has just started, or restarts.

Thread safety: all functions and methods. A lost note of an absence does no harm.
"""

from __future__ import annotations

import random
import time
import weakref
from typing import Final, Protocol

import zenoh

from zenoh_tf import wire
from zenoh_tf._net.queries import NoReply
from zenoh_tf.errors import ServerBusy, ServerUnavailable
from zenoh_tf.steps import Ask, Pause, Steps, decode

from .server_info import ServerInfo

#: A router without the server is asked again for so long, then calls fail at once.
ABSENT_S: Final = 3.0
#: Before a query that ended at once is sent again.
PAUSE_S: Final = 0.02


class RetryingExchange(Protocol):
    """What is needed of the `RetryingExchange` that retries."""

    timeout_s: float
    moves: bool
    absence: Absence

    def router(self) -> str | None:
        """The id of the router that the client sits on."""

    def greet(self, timeout_s: float | None = None) -> Steps[ServerInfo]:
        """Ask the server who it is."""

    def check_instance(self, reply: wire.Message | NoReply) -> None:
        """Forget the server if another one replied, or none."""


class Absence:
    """How long a router has been there without the server, as the queries of a client found."""

    def __init__(self, exchange: RetryingExchange) -> None:
        self._exchange = weakref.ref(exchange)
        self._since_s: float | None = None

    def ended(self) -> None:
        """The server has replied."""
        self._since_s = None

    def may_end(self, deadline_s: float) -> bool:
        """Whether to send a query again, before a deadline, that has just ended at once. Not
        without a connection: it takes Zenoh a second to have another one. A client with several
        endpoints is about to have one.

        Raises ServerUnavailable if the session is closed.
        """
        exchange = self._exchange()
        if exchange is None:
            return False
        has_router = exchange.router() is not None
        now_s = time.monotonic()
        if exchange.moves:
            return now_s + PAUSE_S < deadline_s
        if not has_router:
            self._since_s = None
            return False
        since_s = self._since_s = now_s if self._since_s is None else self._since_s
        return now_s + PAUSE_S < min(deadline_s, since_s + ABSENT_S)


def greet(exchange: RetryingExchange) -> Steps[ServerInfo]:
    """As `RetryingExchange.greet`, of a server that may not be there yet."""
    deadline_s = time.monotonic() + exchange.timeout_s
    while True:
        try:
            return (yield from exchange.greet(max(deadline_s - time.monotonic(), 0.001)))
        except ServerUnavailable:
            if not exchange.absence.may_end(deadline_s):
                raise
        yield Pause(PAUSE_S)


def while_busy(
    exchange: RetryingExchange,
    reply: wire.Message | NoReply,
    key: zenoh.KeyExpr,
    payload: bytes,
    deadline_s: float,
    writes: bool = False,
) -> Steps[wire.Message | NoReply]:
    """Return the reply to a query; send the query again as long as the server is busy and the
    time is not over.

    A read that got refusals and then no reply within its time has been refused: the last try had
    little time. A write may have been applied then.
    """
    while True:
        exchange.check_instance(reply)
        if isinstance(reply, NoReply) or "error" not in reply:
            return reply
        error = wire.decode_error(reply["error"])
        pause_s = error.retry_after_s
        if not isinstance(error, ServerBusy) or pause_s is None or pause_s < 0:
            return reply
        # Clients that were refused together should not come back together.
        pause_s *= random.uniform(1, 2)
        timeout_s = deadline_s - time.monotonic() - pause_s
        if timeout_s <= 0:
            return reply
        yield Pause(pause_s)
        refusal, reply = reply, decode((yield Ask(key, payload, timeout_s)))
        if isinstance(reply, NoReply) and not reply.at_once and not writes:
            exchange.check_instance(reply)
            return refusal
