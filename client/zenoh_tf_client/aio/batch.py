"""`AsyncBatch`: many operations in one round trip, in order, each with its own result or error.

async with tf.batch() as batch:
    camera = batch.lookup_transform("map", "camera")
    stored = batch.set_transform(stamped)
camera.result(), stored.result()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from zenoh_tf.errors import TransformException

from ..requests.batch import BatchRequest
from ..requests.batch_operations import BatchOperations
from ..requests.handle import Handle
from ..requests.request import Request
from .session.connection import AsyncConnection

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")


class AsyncBatch(BatchOperations):
    """Records operations and sends them in one message; made by `AsyncTransformClient.batch`.

    A context manager: the end of the block sends the batch, unless an exception ends it. The server
    runs the operations in order, each in a transaction of its own; operations of other clients may
    run in between. An operation that fails does not affect the others. Lookups with a
    `timeout_s` wait side by side, and the reply comes when the last of them is done. In a
    batch that also writes, such lookups fail with InvalidArgumentException.

    The operations are methods with the names and arguments of the client's, and return a `Handle`
    of what those return: all lookups and estimates except `deskew`; `set_transform` and
    `set_transforms_xact`; `frames`, `frame`, `authorities`, `parent`, `chain` and `stats`. Invalid
    arguments raise at once.

    Concurrency: one thread or task at a time.
    """

    def __init__(self, connection: AsyncConnection) -> None:
        """Use `AsyncTransformClient.batch` instead."""
        self._connection = connection
        self._recorded: list[tuple[Request[Any], Handle[Any]]] = []

    def __repr__(self) -> str:
        opened = self._connection.opened
        return (
            f"<AsyncBatch of {len(self._recorded)} operations for {opened.endpoint}, "
            f"tree {opened.tree!r}, {'closed' if self._connection.closed else 'open'}>"
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, kind: object, *_: object) -> None:
        if kind is None:
            await self.send()

    async def send(self) -> None:
        """Send what was recorded since the last call, and wait for the results.

        If it raises, every handle raises the same error.

        Raises:
            LimitExceeded: The message is too large, or the server's backlog of requests is full.
            InvalidArgumentException: A `timeout_s` is not from 0 to 3600 s.
            ServiceException: As for every call of the client, and every write if the batch writes.
        """
        recorded, self._recorded = self._recorded, []
        if not recorded:
            return
        try:
            await self._connection.call(BatchRequest(recorded))
        except TransformException as error:
            for _, handle in recorded:
                handle._fail(error)
            raise

    def _record(self, request: Request[T]) -> Handle[T]:
        handle: Handle[T] = Handle()
        self._recorded.append((request, handle))
        return handle
