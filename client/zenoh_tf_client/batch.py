"""`Batch`: many operations in one round trip, in order, each with its own result or error.

with tf.batch() as batch:
    camera = batch.lookup_transform("map", "camera")
    stored = batch.set_transform(stamped)
camera.result(), stored.result()
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, TypeVar

from zenoh_tf import wire
from zenoh_tf.errors import TransformException

from . import columns, requests
from .batch_operations import BatchOperations
from .connection import Connection
from .handle import Handle
from .requests import Read, Request

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
            operations, settlers = _join(recorded)
            writes = any(request.writes for request, _ in recorded)
            wait_s = max(request.wait_s for request, _ in recorded)
            replies = wire.parse_batch_reply(
                self._request(operations, writes, wait_s), len(operations)
            )
        except TransformException as error:
            for _, handle in recorded:
                handle._settle(_raise, error)
            raise
        for settle, reply in zip(settlers, replies, strict=True):
            settle(reply)

    def _request(
        self, operations: list[tuple[str, wire.Message]], writes: bool, wait_s: float
    ) -> wire.Message:
        body = wire.batch_body(operations)
        if writes:
            return self._connection.write("batch", body)
        return self._connection.read("batch", body, wait_s)

    def _record(self, request: Request[T]) -> Handle[T]:
        handle: Handle[T] = Handle()
        self._recorded.append((request, handle))
        return handle


def _raise(error: TransformException) -> Any:
    raise error


_Settle = Callable[[wire.Message], None]


def _join(
    recorded: list[tuple[Request[Any], Handle[Any]]],
) -> tuple[list[tuple[str, wire.Message]], list[_Settle]]:
    """Return the operations to send, and for each a function that takes its reply.

    Neighbouring single reads with equal time-outs become one operation.
    """
    operations: list[tuple[str, wire.Message]] = []
    settlers: list[_Settle] = []
    run: list[tuple[Read[Any], Handle[Any]]] = []

    def end_run() -> None:
        if run:
            lookup = columns.join([read.row for read, _ in run])
            lookup.timeout_ns = requests.timeout_ns(run[0][0].wait_s)
            operations.append(("lookup", wire.lookup_body(lookup)))
            settlers.append(_settler_of_reads(run.copy()))
            run.clear()

    for request, handle in recorded:
        if isinstance(request, Read):
            if run and run[0][0].wait_s != request.wait_s:
                end_run()
            run.append((request, handle))
        else:
            end_run()
            operations.append((request.kind, request.body()))
            settlers.append(_settler(request, handle))
    end_run()
    return operations, settlers


def _settler(request: Request[Any], handle: Handle[Any]) -> _Settle:
    return lambda reply: handle._settle(request.parse, reply)


def _settler_of_reads(run: list[tuple[Read[Any], Handle[Any]]]) -> _Settle:
    def settle(reply: wire.Message) -> None:
        try:
            answer = wire.parse_lookup_reply(reply, len(run))
        except TransformException as error:
            for _, handle in run:
                handle._settle(_raise, error)
            return
        for (read, handle), row in zip(run, answer.rows(), strict=True):
            handle._sent = True
            try:
                handle._value = read.result(row)
            except TransformException as error:
                handle._error = error

    return settle
