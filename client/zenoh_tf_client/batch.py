"""`Batch`: many operations in one round trip, in order, each with its own result or error.

with tf.batch() as batch:
    camera = batch.lookup_transform("map", "camera")
    stored = batch.set_transform(stamped)
camera.result(), stored.result()
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, TypeVar

from zenoh_tf import wire
from zenoh_tf.errors import TransformException

from . import columns
from .batch_operations import BatchOperations
from .connection import Connection
from .handle import Handle
from .request import Read, Request, timeout_ns

T = TypeVar("T")


class Batch(BatchOperations):
    """Records operations and sends them in one message; made by `TransformClient.batch`.

    A context manager: the end of the block sends the batch, unless an exception ends it. The server
    runs the operations in order, each in a transaction of its own; operations of other clients may
    run in between. An operation that fails does not affect the others. Lookups with a
    `timeout_s` wait side by side, and the reply comes when the last of them is done. In a
    batch that also writes, such lookups fail with InvalidArgumentException.

    Thread safety: one thread at a time.
    """

    def __init__(self, connection: Connection) -> None:
        """Use `TransformClient.batch` instead.

        Args:
            connection: The connection to send the batch on.
        """
        self._connection = connection
        self._recorded: list[tuple[Request[Any], Handle[Any]]] = []

    def __repr__(self) -> str:
        state = "closed" if self._connection.closed else "open"
        return (
            f"<Batch of {len(self._recorded)} operations for {self._connection.endpoint}, "
            f"tree {self._connection.tree!r}, {state}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.send()

    def send(self) -> None:
        """Send what was recorded since the last call, and wait for the results.

        If it raises, every handle raises the same error.

        Raises:
            ServerUnavailable: No server answered in time, or the client is closed.
            OutcomeUnknown: No reply came to a batch that writes, which may have been applied.
            ServerRestarted: The server was restarted while the batch was sent; nothing was applied.
            LimitExceeded: The message is too large, or the server's backlog of requests is full.
            InvalidArgumentException: A `timeout_s` is not from 0 to 3600 s.
            ProtocolError: The reply is malformed.
        """
        recorded, self._recorded = self._recorded, []
        if not recorded:
            return
        try:
            self._connection.call(_BatchRequest(recorded))
        except TransformException as error:
            for _, handle in recorded:
                handle._fail(error)
            raise

    def _record(self, request: Request[T]) -> Handle[T]:
        handle: Handle[T] = Handle()
        self._recorded.append((request, handle))
        return handle


_Settle = Callable[[wire.Message], None]


class _BatchRequest(Request[None]):
    """All recorded operations in one message; its reply settles their handles."""

    kind = "batch"

    def __init__(self, recorded: list[tuple[Request[Any], Handle[Any]]]) -> None:
        """Raises InvalidArgumentException if a time-out is out of range."""
        self._writes = any(request.writes for request, _ in recorded)
        self.wait_s = max(request.wait_s for request, _ in recorded)
        self._operations: list[tuple[str, wire.Message]] = []
        self._settlers: list[_Settle] = []  # for each operation a function that takes its reply
        # Neighbouring single reads with equal time-outs become one operation.
        for wait_s, group in itertools.groupby(recorded, _wait_of_read):
            if wait_s is None:
                for request, handle in group:
                    self._add(request.kind, request.body(), _settler(request, handle))
            else:
                reads: list[tuple[Read[Any], Handle[Any]]] = list(group)  # type: ignore[arg-type]
                lookup = columns.join([read.row for read, _ in reads])
                lookup.timeout_ns = timeout_ns(wait_s)
                self._add("lookup", wire.lookup_body(lookup), _settler_of_reads(reads))

    @property
    def writes(self) -> bool:
        return self._writes

    def body(self) -> wire.Message:
        return wire.batch_body(self._operations)

    def parse(self, reply: wire.Message) -> None:
        replies = wire.parse_batch_reply(reply, len(self._operations))
        for settle, one in zip(self._settlers, replies, strict=True):
            settle(one)

    def _add(self, kind: str, body: wire.Message, settle: _Settle) -> None:
        self._operations.append((kind, body))
        self._settlers.append(settle)


def _wait_of_read(entry: tuple[Request[Any], Handle[Any]]) -> float | None:
    """The time-out of a single read; None for any other operation."""
    request, _ = entry
    return request.wait_s if isinstance(request, Read) else None


def _settler(request: Request[Any], handle: Handle[Any]) -> _Settle:
    return lambda reply: handle._settle(request.parse, reply)


def _settler_of_reads(reads: list[tuple[Read[Any], Handle[Any]]]) -> _Settle:
    def settle(reply: wire.Message) -> None:
        try:
            answer = wire.parse_lookup_reply(reply, len(reads))
        except TransformException as error:
            for _, handle in reads:
                handle._fail(error)
            return
        for (read, handle), row in zip(reads, answer.rows(), strict=True):
            handle._settle(read.result, row)

    return settle
