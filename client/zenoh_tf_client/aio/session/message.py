"""A call that waits for its result, and the message that asks for it, alone or with others."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

from ...requests.request import Request
from ...session.exchange import Exchange
from .drive import Drive
from .joining import Joined, join
from .transport import Transport

T = TypeVar("T")


class Operation(Generic[T]):
    """A request, and the future that its caller awaits."""

    __slots__ = ("future", "message", "request")

    def __init__(self, request: Request[T], future: asyncio.Future[T]) -> None:
        self.request = request
        self.future = future
        self.message: Message | None = None  # once it is under way

    def succeed(self, result: T) -> None:
        """Give the caller the result."""
        if not self.future.done():
            self.future.set_result(result)

    def settle(self, result: Callable[[], T]) -> None:
        """Give the caller the result, or the error that `result` raises."""
        if self.future.done():  # cancelled
            return
        try:
            self.future.set_result(result())
        except Exception as error:
            self.future.set_exception(error)

    def fail(self, error: Exception) -> None:
        """Give the caller an error."""
        if not self.future.done():
            self.future.set_exception(error)


AnyOperation = Operation[Any]


class Sender(Protocol):
    """What a message asks of the outbox that sends it."""

    def send(self, operations: Sequence[AnyOperation]) -> None:
        """Send operations of one group now."""

    def finished(self, message: Message) -> None:
        """A message is answered, has failed, or is cancelled."""


class Message(Drive):
    """Sends operations together, and gives each its result."""

    __slots__ = ("_joined", "_left", "_operations", "_outbox", "waits")

    def __init__(
        self,
        operations: Sequence[AnyOperation],
        transport: Transport,
        exchange: Exchange,
        outbox: Sender,
    ) -> None:
        first = operations[0].request
        self._joined: Joined | None = None
        if len(operations) > 1:
            self._joined = join([operation.request for operation in operations])
        super().__init__(transport, exchange.call(self._joined or first))
        self._outbox = outbox
        self._operations = operations
        self._left = len(operations)  # those that are not cancelled
        #: Whether the server may wait before it replies.
        self.waits = first.wait_s > 0
        for operation in operations:
            operation.message = self

    def cancel_one(self) -> None:
        """Record that the caller of an operation has gone. Nobody waits after the last one."""
        self._left -= 1
        if self._left == 0:
            self._cancel()
            self._outbox.finished(self)

    def _done(self, result: Any, error: Exception | None) -> None:
        self._outbox.finished(self)
        operations, joined = self._operations, self._joined
        self._operations = ()  # or each would refer to the other, and wait for the collector
        if error is None:
            if joined is None:
                operations[0].succeed(result)
                return
            for operation, each in zip(operations, result, strict=True):
                operation.settle(each)
        elif joined is not None and joined.is_refused(error):
            # Bisects, so that only the operation that is to blame fails.
            waiting = [operation for operation in operations if not operation.future.done()]
            half = (len(waiting) + 1) // 2
            self._outbox.send(waiting[:half])
            self._outbox.send(waiting[half:])
        else:
            for operation in operations:
                operation.fail(error)
