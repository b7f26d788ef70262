"""`TransformFuture`: a waiting lookup as a future, for rclpy's executors and for asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Generator
from concurrent.futures import Future, InvalidStateError
from typing import Any

from zenoh_tf import threads
from zenoh_tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    LookupException,
)

from .messages import TransformStamped
from .times import Duration

#: One lookup waits at most this long and is then repeated, so that a cancelled one ends soon.
_ROUND = Duration(sec=5)

#: Errors of lookups that may succeed after a later write.
_MAY_SUCCEED_LATER = (LookupException, ConnectivityException, ExtrapolationException)


class TransformFuture(Future[TransformStamped]):
    """The result of a lookup that waits until it succeeds, on a thread of its own.

    It has the methods of rclpy's futures (`done`, `result`, `exception`, `cancel`,
    `add_done_callback`). `await` works under asyncio and under rclpy's executors. Unlike rclpy's,
    `result` waits. Callbacks run on the future's thread. The future fails at once if no write can
    make the lookup succeed, as for a time that is older than the server's cache.
    """

    def __init__(self, lookup: Callable[[Duration], TransformStamped]) -> None:
        """Start the lookup.

        Args:
            lookup: Does one lookup; its argument is how long it may wait.
        """
        super().__init__()
        # A daemon, so that a script may end while lookups wait.
        threads.start("tf2 wait", self._run, lookup)

    def __await__(self) -> Generator[Any, None, TransformStamped]:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            while not self.done():  # an rclpy executor, which resumes the coroutine later
                yield
            return self.result()
        return (yield from asyncio.wrap_future(self).__await__())

    def _run(self, lookup: Callable[[Duration], TransformStamped]) -> None:
        with contextlib.suppress(InvalidStateError):  # the future was cancelled meanwhile
            try:
                result = self._wait(lookup)
            except BaseException as error:
                self.set_exception(error)
            else:
                if result is not None:
                    self.set_result(result)

    def _wait(self, lookup: Callable[[Duration], TransformStamped]) -> TransformStamped | None:
        while not self.cancelled():
            begin_s = time.monotonic()
            try:
                return lookup(_ROUND)
            except _MAY_SUCCEED_LATER:
                # The server answers early if no write can make the lookup succeed.
                if time.monotonic() - begin_s < _ROUND.sec / 2:
                    raise
        return None
