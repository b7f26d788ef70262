"""The lookups of futures and message filters, which wait on one event loop.

A waiting lookup costs a task, not a thread, and one that is cancelled leaves nothing behind.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import Any, Final, TypeVar

from zenoh_tf import StampedTransform, threads
from zenoh_tf.errors import MAY_SUCCEED_LATER, ServerUnavailable, ServiceException

from .messages import TransformStamped, message_of

T = TypeVar("T")
#: One lookup with what the loop was made with, which waits for so many seconds at most.
Lookup = Callable[[Any, float], Awaitable[StampedTransform]]

#: One lookup waits at most this long at a server, which allows an hour at most; then again.
_ROUND_S: Final = 60.0


class WaitLoop:
    """An event loop on a thread of its own, with a tree or with the session of a client.

    Thread safety: `start` and `close`.
    """

    def __init__(
        self,
        lookups: Callable[[], AbstractContextManager[Any]],
        is_closed: Callable[[], bool] = lambda: False,
    ) -> None:
        """Start the thread, on which `lookups` gives what has the lookups as coroutines.

        `is_closed`: whether no lookup can succeed any more. Raises ServiceException if the process
        has no thread or file left.
        """
        self._lock = threading.Lock()
        self._closed = False
        self._lookups = lookups
        self.is_closed = is_closed
        self._end = asyncio.Event()
        started: Future[asyncio.AbstractEventLoop] = Future()
        # A daemon, so that a script may end while lookups wait.
        try:
            threads.start("tf2 waits", self._run, started)
            self._loop = started.result()
        except (RuntimeError, OSError) as error:
            raise ServiceException(
                f"no thread can be started for lookups that wait: {error}"
            ) from error

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

    async def look_up(self, lookup: Lookup, deadline_s: float = math.inf) -> TransformStamped:
        """Look up as soon as the transform exists. For coroutines that `start` runs.

        Raises the lookup's error at the deadline, or once no write can make it succeed.
        """
        while True:
            begin_s = time.monotonic()
            wait_s = max(0.0, min(_ROUND_S, deadline_s - begin_s))
            try:
                return message_of(await lookup(self._client, wait_s))
            except MAY_SUCCEED_LATER:
                # A lookup ends early if no write can make it succeed.
                if wait_s < _ROUND_S or time.monotonic() - begin_s < _ROUND_S / 2:
                    raise

    def _run(self, started: Future[asyncio.AbstractEventLoop]) -> None:
        main = self._main(started)
        try:
            asyncio.run(main)
        except BaseException as error:
            main.close()
            # The constructor waits for `started`, and holds the lock of the connection.
            if started.done():
                raise
            started.set_exception(error)

    async def _main(self, started: Future[asyncio.AbstractEventLoop]) -> None:
        with self._lookups() as self._client:  # for the coroutines that `start` runs
            started.set_result(asyncio.get_running_loop())
            await self._end.wait()  # `asyncio.run` then cancels what is left
