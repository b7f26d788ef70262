"""What a client with several endpoints says to whichever server or replica its link leads to.

A query that ends without a reply did so because its link is gone: Zenoh connects to the next
endpoint, and the client asks there, until its time is over. A write is sent again with the same id
and expiry, so the server that has executed it repeats its first reply, and executes it once.

Thread safety: all methods; steps of different threads run side by side.
"""

from __future__ import annotations

import time
from typing import Any, Final, TypeVar

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf._net.queries import NoReply
from zenoh_tf.errors import ServerUnavailable, TransformException

from ..requests.request import Request
from ..session.exchange import Exchange
from ..session.steps import Ask, Pause, Steps

T = TypeVar("T")

#: Before a request is sent again.
_PAUSE_S: Final = 0.02
_WRITES: Final = ("commit", "batch", "admin")


class FailoverExchange(Exchange):
    """The exchange of one client with the server of one tree and its replicas."""

    def __init__(self, tree: str, address: str, user: str | None, timeout_s: float) -> None:
        super().__init__(tree, address, user, timeout_s)
        self._replica_keys = f"{keys.prefix(tree)}/at/"
        self._write_keys = tuple(keys.request(tree, each) for each in _WRITES)
        #: How often `forget` was called. A lost count does no harm.
        self.changes = 0

    def forget(self) -> None:
        """Ask again who answers: the link leads to another router, or to a new one."""
        self.changes += 1
        self.server = None
        self.replica = None

    def call(self, request: Request[T]) -> Steps[T]:
        """As `Exchange.call`, at any of the endpoints."""
        deadline_s = time.monotonic() + self.timeout_s + request.wait_s
        while True:
            attempt = _Attempt(self, deadline_s, writes=request.writes)
            try:
                return (yield from attempt.take(super().call(request)))
            except ServerUnavailable:
                if not attempt.may_ask_again or time.monotonic() + _PAUSE_S >= deadline_s:
                    raise
            yield Pause(_PAUSE_S)

    def begins_again(self, key: zenoh.KeyExpr, changes: int) -> bool:
        """Whether a read whose query ended without a reply is to ask who answers.

        Not the server, which `Exchange` would ask next: it may be the one that is stopped.
        `changes`: when the query was sent.
        """
        replica = self.replica
        if replica is not None and key in replica.keys.values():
            self.forget()
        text = str(key)
        is_read = text.startswith(self._replica_keys) and not text.endswith("/hello")
        return is_read or changes != self.changes

    def is_write(self, key: zenoh.KeyExpr) -> bool:
        """Whether a key is one that writes are sent on."""
        return str(key).startswith(self._write_keys)


class _Attempt:
    """The steps of one request, taken until its result or error."""

    def __init__(self, exchange: FailoverExchange, deadline_s: float, *, writes: bool) -> None:
        self._exchange = exchange
        self._deadline_s = deadline_s
        self._writes = writes
        #: The last query did not wait in vain: a server replied, or none was there.
        self.may_ask_again = False

    def take(self, steps: Steps[T]) -> Steps[T]:
        """Take the steps of `Exchange`, none of which waits beyond the deadline."""
        outcome: bytes | NoReply | None = None
        error: TransformException | None = None
        while True:
            try:
                step = steps.send(outcome) if error is None else steps.throw(error)
            except StopIteration as end:
                result: T = end.value
                return result
            outcome = error = None
            if isinstance(step, Pause):
                yield step
                continue
            changes = self._exchange.changes
            try:
                outcome = yield from self._ask(step)
            except TransformException as failure:
                self.may_ask_again = False  # the connection is closed
                error = failure
            if self._writes or not isinstance(outcome, NoReply) or not outcome.at_once:
                continue
            if self._exchange.begins_again(step.key, changes):
                steps.close()
                raise ServerUnavailable(outcome.reason)

    def _ask(self, step: Ask) -> Steps[bytes | NoReply]:
        server = self._exchange.server
        outcome: bytes | NoReply = yield self._bounded(step)
        if self._writes and server is not None and self._exchange.is_write(step.key):
            outcome = yield from self._send_again(step, outcome, server.instance)
        self.may_ask_again = not isinstance(outcome, NoReply) or outcome.at_once
        return outcome

    def _send_again(
        self, step: Ask, outcome: bytes | NoReply, instance: str
    ) -> Steps[bytes | NoReply]:
        """The first reply to a write. Only the server instance that it was for knows what became of
        it, so that of another one is none."""
        first = outcome
        while isinstance(outcome, NoReply) and outcome.at_once:
            if time.monotonic() + _PAUSE_S >= self._deadline_s:
                break
            yield Pause(_PAUSE_S)
            outcome = yield self._bounded(step)
        if isinstance(first, NoReply) and not isinstance(outcome, NoReply):
            message: dict[str, Any] = wire.unpack(outcome, wire.MAX_REPLY_BYTES)
            if message.get("instance") != instance:
                return first
        return outcome

    def _bounded(self, step: Ask) -> Ask:
        left_s = max(self._deadline_s - time.monotonic(), 0.001)
        return Ask(step.key, step.payload, min(step.timeout_s, left_s))
