"""Lookups that wait as futures, for rclpy's executors and for asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import Future, InvalidStateError
from typing import Any

from zenoh_tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    LookupException,
)

from .messages import Duration, TransformStamped

#: A wait is asked for in rounds of this length, so that a cancelled one ends soon.
_ROUND = Duration(sec=5)

#: What a later write may put right.
_MAY_COME = (LookupException, ConnectivityException, ExtrapolationException)


class TransformFuture(Future[TransformStamped]):
    """The outcome of a lookup that waits until it succeeds, on a thread of its own.

    Has the methods that rclpy's futures have (`done`, `result`, `exception`, `cancel`,
    `add_done_callback`), and `await` works under asyncio and under rclpy's executors. Unlike
    rclpy's, `result` waits. Callbacks run on the future's thread. Fails at once where no
    write can help, as for a time older than what the tree keeps.
    """

    def __init__(self, lookup: Callable[[Duration], TransformStamped]) -> None:
        """`lookup` takes how long to wait."""
        super().__init__()
        # No daemon: Python may not end while a thread is inside of Zenoh.
        threading.Thread(target=self._run, args=(lookup,), name="tf2 wait").start()

    def __await__(self) -> Generator[Any, None, TransformStamped]:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            while not self.done():  # an rclpy executor, which comes back later
                yield
            return self.result()
        return (yield from asyncio.wrap_future(self).__await__())

    def _run(self, lookup: Callable[[Duration], TransformStamped]) -> None:
        with contextlib.suppress(InvalidStateError):  # cancelled meanwhile
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
            except _MAY_COME:
                # An error long before the round is over: the server knows that waiting is idle.
                if time.monotonic() - begin_s < _ROUND.sec / 2:
                    raise
        return None
