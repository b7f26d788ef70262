"""A message that is under way, for one operation or for several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..exchange import Exchange
from .drive import Drive
from .operation import AnyOperation
from .sharing import Shared, share
from .transport import Transport


class Message:
    """Sends operations together, and gives each its result."""

    __slots__ = ("_again", "_drive", "_finished", "_left", "_operations", "_shared")

    def __init__(
        self,
        operations: Sequence[AnyOperation],
        transport: Transport,
        exchange: Exchange,
        finished: Callable[[Message], None],
        again: Callable[[Sequence[AnyOperation]], None],
    ) -> None:
        """`finished` is called at the end, `again` with operations that are to be sent anew."""
        self._operations = operations
        self._left = len(operations)  # those that are not cancelled
        self._finished = finished
        self._again = again
        requests = [operation.request for operation in operations]
        self._shared: Shared | None = share(requests) if len(requests) > 1 else None
        for operation in operations:
            operation.message = self
        steps = exchange.call(requests[0] if self._shared is None else self._shared)
        self._drive = Drive(transport, steps, self._done)

    @property
    def waits(self) -> bool:
        """Whether the server may wait before it replies."""
        return self._operations[0].request.wait_s > 0

    def start(self) -> None:
        """Send it."""
        self._drive.start()

    def end(self, reason: str) -> None:
        """Take no reply any more. Operations that are not done fail."""
        self._drive.end(reason)

    def cancel_one(self) -> None:
        """Note that the caller of an operation has gone. Nobody waits after the last one."""
        self._left -= 1
        if self._left == 0:
            self._drive.cancel()
            self._finished(self)

    def _done(self, result: Any, error: Exception | None) -> None:
        self._finished(self)
        operations = self._operations
        if self._shared is None:
            if error is None:
                operations[0].settle(lambda: result)
            else:
                operations[0].fail(error)
        elif error is None:
            for operation, each in zip(operations, result, strict=True):
                operation.settle(each)
        elif self._shared.is_refused(error):
            # Bisects, so that only the operation that is to blame fails.
            waiting = [operation for operation in operations if not operation.future.done()]
            half = (len(waiting) + 1) // 2
            self._again(waiting[:half])
            self._again(waiting[half:])
        else:
            for operation in operations:
                operation.fail(error)
