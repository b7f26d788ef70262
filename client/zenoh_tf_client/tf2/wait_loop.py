"""The lookups of message filters, which wait at the server, on one event loop of the process.

A waiting lookup costs a task, not a thread, and one that is cancelled leaves the server at once.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

from zenoh_tf import threads
from zenoh_tf.errors import ServerUnavailable
from zenoh_tf_client.aio.client import AsyncTransformClient
from zenoh_tf_client.aio.session.connection import Connection
from zenoh_tf_client.client import TransformClient

T = TypeVar("T")


class WaitLoop:
    """An event loop on a thread of its own, with the session of a client.

    Thread safety: `start` and `close`.
    """

    def __init__(self, client: TransformClient) -> None:
        """Start the thread. `client` must stay open until `close`."""
        self._lock = threading.Lock()
        self._closed = False
        self._owner = client
        self._end = asyncio.Event()
        started: Future[asyncio.AbstractEventLoop] = Future()
        # A daemon, so that a script may end while lookups wait.
        threads.start("tf2 waits", lambda: asyncio.run(self._main(started)))
        self._loop = started.result()

    @property
    def is_closed(self) -> bool:
        """Whether the client is closed, so that no lookup can succeed."""
        return self._owner._connection.closed

    def start(self, coroutine: Coroutine[Any, Any, T]) -> Future[T]:
        """Run a coroutine on the loop. The future's `cancel` cancels it.

        Raises ServerUnavailable if the loop is closed.
        """
        with self._lock:
            if not self._closed:
                return asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        coroutine.close()
        raise ServerUnavailable("the connection is closed")

    def close(self) -> None:
        """Cancel all coroutines and end the thread. May be called again."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._loop.call_soon_threadsafe(self._end.set)

    async def _main(self, started: Future[asyncio.AbstractEventLoop]) -> None:
        #: For the coroutines that `start` runs.
        owner = self._owner
        self.client = AsyncTransformClient(Connection(owner._connection, owner._reads.mapped))
        started.set_result(asyncio.get_running_loop())
        await self._end.wait()  # `asyncio.run` then cancels what is left
