"""What the asynchronous client sends next: the calls of one turn of the loop, as few messages.

A call is sent at the end of the turn in which it was made, together with the other calls of that
turn that may share its message. While many messages are under way, calls collect until one of
them is answered.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Final, Generic, TypeVar

from zenoh_tf.errors import ServerUnavailable
from zenoh_tf.steps import LoopSteps

from ...requests.request import Request
from ...session.exchange import Exchange
from .joining import Joined, join
from .transport import Transport

T = TypeVar("T")

#: Messages under way, apart from lookups that wait at the server: several, so that client and
#: server work at the same time, and few, so that calls collect when either falls behind.
_MESSAGES: Final = 16
#: Operations in one message: more would gain little, and delay the first.
_OPERATIONS: Final = 1000


class Operation(Generic[T]):
    """A request, and the future that its caller awaits."""

    __slots__ = ("future", "message", "request")

    def __init__(self, request: Request[T], future: asyncio.Future[T]) -> None:
        self.request = request
        self.future = future
        self.message: OutboxMessage | None = None  # once it is under way

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


class OutboxMessage(LoopSteps):
    """Sends operations together, and gives each its result."""

    __slots__ = ("_joined", "_left", "_operations", "_outbox", "waits")

    def __init__(
        self,
        operations: Sequence[AnyOperation],
        transport: Transport,
        exchange: Exchange,
        outbox: Outbox,
    ) -> None:
        first = operations[0].request
        self._joined: Joined | None = None
        if len(operations) > 1:
            self._joined = join([operation.request for operation in operations])
        super().__init__(transport, exchange.steps(self._joined or first))
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


class Outbox:
    """The operations of one loop that are not done. Thread safety: the loop's thread."""

    def __init__(self, transport: Transport, exchange: Exchange) -> None:
        self._transport = transport
        self._exchange = exchange
        self._new: list[AnyOperation] = []  # of this turn
        # By group, in the order of their first operations; one that travels alone is a group.
        self._collected: dict[Hashable, dict[AnyOperation, None]] = {}
        self._is_scheduled = False
        self._under_way: set[OutboxMessage] = set()
        self._waiting = 0  # of them: those that wait at the server

    def __len__(self) -> int:
        """How many messages are under way or collected."""
        return len(self._under_way) + len(self._collected) + len(self._new)

    def add(self, operation: AnyOperation) -> None:
        """Send an operation at the end of this turn, or when others are answered."""
        if operation.request.wait_s:
            self.send([operation])
            return
        self._new.append(operation)
        if not self._is_scheduled:
            self._is_scheduled = True
            self._transport.loop.call_soon(self._flush)

    def cancel(self, operation: AnyOperation) -> bool:
        """Forget an operation. Returns whether it was sent."""
        message = operation.message
        if message is not None:
            if message in self._under_way:
                message.cancel_one()
            return True
        key = operation.request.group or operation
        group = self._collected.get(key)
        if group is not None:
            group.pop(operation, None)
            if not group:
                del self._collected[key]
        return False

    def end(self, reason: str) -> None:
        """Let every operation fail that is not done."""
        collected, self._collected = self._collected, {}
        new, self._new = self._new, []
        for operation in itertools.chain(new, *collected.values()):
            operation.fail(ServerUnavailable(reason))
        for message in list(self._under_way):
            message.end(reason)

    def _flush(self) -> None:
        self._is_scheduled = False
        new, self._new = self._new, []
        operations = [operation for operation in new if not operation.future.done()]
        if len(operations) == 1 and not self._collected and self._has_room:  # the common case
            self.send(operations)
            return
        for operation in operations:
            key = operation.request.group or operation
            self._collected.setdefault(key, {})[operation] = None
        self._send_collected()

    @property
    def _has_room(self) -> bool:
        return len(self._under_way) - self._waiting < _MESSAGES

    def _send_collected(self) -> None:
        server = self._exchange.server
        most = _OPERATIONS if server is None else max(1, min(_OPERATIONS, server.rows))
        while self._collected and self._has_room:
            key = next(iter(self._collected))
            group = self._collected.pop(key)
            operations = list(group)
            if len(operations) > most:
                operations = operations[:most]
                for operation in operations:
                    del group[operation]
                self._collected[key] = group  # behind the other groups
            self.send(operations)

    def send(self, operations: Sequence[AnyOperation]) -> None:
        """Send operations of one group now."""
        if operations:
            message = OutboxMessage(operations, self._transport, self._exchange, self)
            self._under_way.add(message)
            self._waiting += message.waits
            message.start()

    def finished(self, message: OutboxMessage) -> None:
        """A message is answered, has failed, or is cancelled."""
        self._under_way.remove(message)
        self._waiting -= message.waits
        if self._collected:
            self._transport.loop.call_soon(self._send_collected)
