"""`TransformFuture`: a waiting lookup as a future, for rclpy's executors and for asyncio."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Generator
from concurrent.futures import CancelledError, Future, InvalidStateError
from typing import Any

from zenoh_tf import threads
from zenoh_tf.errors import ServerUnavailable, ServiceException

from .messages import TransformStamped
from .wait_loop import Lookup, WaitLoop


class TransformFuture(Future[TransformStamped]):
    """The result of a lookup that waits until it succeeds.

    It has the methods of rclpy's futures (`done`, `result`, `exception`, `cancel`,
    `add_done_callback`). `await` works under asyncio and under rclpy's executors. Unlike rclpy's,
    `result` waits. Callbacks run on a thread of the future. The future fails at once if no write
    can make the lookup succeed, as for a time that is older than the cache.
    """

    def __init__(self, waits: Callable[[], WaitLoop], lookup: Lookup) -> None:
        """Start a lookup on the loop that `waits` returns."""
        super().__init__()
        try:
            # To connect may take seconds, and the caller may be an event loop.
            threads.start("tf2 wait", self._begin, waits, lookup)
        except RuntimeError as error:
            self.set_exception(ServiceException(f"no thread can be started to wait: {error}"))

    def __await__(self) -> Generator[Any, None, TransformStamped]:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            while not self.done():  # an rclpy executor, which resumes the coroutine later
                yield
            return self.result()
        return (yield from asyncio.wrap_future(self).__await__())

    def _begin(self, waits: Callable[[], WaitLoop], lookup: Lookup) -> None:
        try:
            loop = waits()
            waiting = loop.start(loop.look_up(lookup))
        except BaseException as error:
            with contextlib.suppress(InvalidStateError):
                self.set_exception(error)
            return
        self.add_done_callback(lambda _: waiting.cancel())
        waiting.add_done_callback(self._end)

    def _end(self, waiting: Future[TransformStamped]) -> None:
        """Settle on a thread: a callback may block, which the loop must not."""
        try:
            threads.start("tf2 wait", self._settle, waiting)
        except RuntimeError:  # the system has no thread left
            self._settle(waiting)

    def _settle(self, waiting: Future[TransformStamped]) -> None:
        with contextlib.suppress(InvalidStateError):  # the future was cancelled meanwhile
            try:
                result = waiting.result()
            except CancelledError:
                self.set_exception(ServerUnavailable("the connection is closed"))
            except BaseException as error:
                self.set_exception(error)
            else:
                self.set_result(result)
