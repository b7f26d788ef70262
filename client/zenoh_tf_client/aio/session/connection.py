"""The connection of an asynchronous client: it belongs to one event loop.

Zenoh's session, and what is said to the server, are those of the synchronous `AsyncConnection`.

Thread safety: the loop's thread only.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

from zenoh_tf._net.credentials import Credentials
from zenoh_tf.errors import OutcomeUnknown, ServerUnavailable
from zenoh_tf.shared_tree import AskServer

from ...requests.request import Request
from ...session import connection
from ...session.mapped_tree import MappedTree, Mode
from .outbox import Operation, Outbox
from .threads import in_thread
from .transport import Transport
from .waits import Wait, Waits

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")

#: Calls of one client that are under way; further callers wait for room. docs/how-to/asyncio.md has
#: both.
MAX_CALLS: Final = 4000
#: The same for lookups with a `timeout_s`. They have room of their own: they may wait for what
#: another call is about to write. Fewer, as each is a message, and servers take 2,048 at once.
MAX_WAITING_LOOKUPS: Final = 2000

_CLOSED: Final = "the connection is closed"


class AsyncConnection:
    """Makes the calls of one loop; see the module. Close it with `close`."""

    def __init__(self, opened: connection.Connection, mapped: MappedTree) -> None:
        """Use an open connection from the running loop, and the tree that it has mapped."""
        self.opened = opened
        self.mapped = mapped
        self._loop = asyncio.get_running_loop()
        self._transport = Transport(self._loop, opened)
        self._outbox = Outbox(self._transport, opened)
        self._waits = Waits(self._transport, opened)
        self._room = asyncio.Semaphore(MAX_CALLS)
        self._waiting_room = asyncio.Semaphore(MAX_WAITING_LOOKUPS)

    def __del__(self) -> None:
        # The loop would keep the files of a client that nobody uses any more.
        if hasattr(self, "_transport") and not self.closed:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._transport.close)

    @classmethod
    async def open(
        cls,
        endpoint: str | Sequence[str],
        tree: str,
        timeout_s: float,
        credentials: Credentials,
        reads: Mode,
    ) -> Self:
        """Connect; raises what the synchronous `AsyncConnection` raises."""

        def connect() -> tuple[connection.Connection, MappedTree]:
            opened = connection.Connection(endpoint, tree, timeout_s, credentials)
            return opened, MappedTree(opened, reads)

        def close(opened: tuple[connection.Connection, MappedTree]) -> None:
            opened[0].close()
            opened[1].close()

        return cls(*await in_thread(connect, undo=close))

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self._transport.is_closed

    async def call(self, request: Request[T], why: Any = None) -> T:
        """Send a request; return its result, or raise its error; `why`: as for `Exchange.call`.

        A cancelled call leaves nothing behind. If it was a write that was sent, the cause of the
        CancelledError is OutcomeUnknown.
        """
        self._check_loop()
        self.opened.asked[why] += 1
        if why is AskServer.LAPSED:
            self.opened.report_server()
        room = self._room
        if request.wait_s:
            room, request = self._waiting_room, self._waits.named(request)
        await room.acquire()
        operation: Operation[T] = Operation(request, self._loop.create_future())
        try:
            self._outbox.add(operation)
            return await operation.future
        except asyncio.CancelledError as cancelled:
            if self._outbox.cancel(operation):
                if isinstance(request, Wait):
                    self._waits.cancel(request)
                elif request.writes:
                    raise cancelled from OutcomeUnknown(
                        "the call was cancelled: the write may or may not have been applied"
                    )
            raise
        finally:
            room.release()

    async def run(self, call: Callable[[], T]) -> T:
        """Return what a blocking call returns, which a thread makes after all earlier ones.

        Raises ServerUnavailable if the connection is closed.
        """
        self._check_loop()
        async with self._room:
            if self.closed:
                raise ServerUnavailable(_CLOSED)
            return await self._transport.worker.run(call)

    async def close(self, session: Callable[[], None]) -> None:
        """Close the connection, and the session by a call of `session`. May be called again.

        Calls that wait for a reply fail at once.
        """
        self._check_loop()
        self._transport.close()
        self._outbox.end(_CLOSED)
        await in_thread(session)

    def _check_loop(self) -> None:
        if asyncio.get_running_loop() is not self._loop:
            raise RuntimeError(
                "this client belongs to another event loop: each loop needs a client of its own"
            )
