"""Lets event loops wait for what threads make: the asynchronous iterators of gates and watches; and
for lookups, in rounds."""

from __future__ import annotations

import contextlib
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TypeVar

from zenoh_tf.errors import MAY_SUCCEED_LATER

T = TypeVar("T")


async def in_rounds(
    lookup: Callable[[float], Awaitable[T]], deadline_s: float, longest_s: float
) -> T:
    """Repeat a lookup, whose argument is its time-out, until it succeeds. No round is longer than
    `longest_s`. Raises the lookup's error at the deadline, or once no write can make it succeed."""
    while True:
        begin_s = time.monotonic()
        round_s = max(0.0, min(longest_s, deadline_s - begin_s))
        try:
            return await lookup(round_s)
        except MAY_SUCCEED_LATER:
            # A lookup ends early if no write can make it succeed.
            if round_s < longest_s or time.monotonic() - begin_s < longest_s / 2:
                raise


class LoopWaits:
    """The event loops that wait for changes of one object. Thread safety: all methods."""

    def __init__(self) -> None:
        self._alarms: list[_Alarm] = []

    def wake(self) -> None:
        """Let every loop try again. Never waits."""
        for alarm in tuple(self._alarms):
            alarm.send()

    async def events(
        self,
        take: Callable[[], T | None],
        is_closed: Callable[[], bool],
        longest_s: Callable[[], float | None] = lambda: None,
    ) -> AsyncIterator[T]:
        """Yield what `take` returns, until `is_closed`.

        `take` is called without waiting, on the loop: after each `wake`, and `longest_s` after the
        last call. So a task that is cancelled takes nothing with it.
        """
        alarm = _Alarm()
        self._alarms.append(alarm)
        try:
            while True:
                alarm.event.clear()  # first: what comes from now on sets it again
                if (found := take()) is not None:
                    yield found
                elif is_closed():
                    return
                else:
                    await alarm.wait(longest_s())
        finally:
            self._alarms.remove(alarm)


class _Alarm:
    """Sets an event of the running loop from another thread."""

    def __init__(self) -> None:
        import asyncio  # noqa: PLC0415 - most programs need none

        self.event = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._is_sent = False

    async def wait(self, longest_s: float | None) -> None:
        """Wait until the event is set, which it is after `longest_s` at the latest."""
        timer = None if longest_s is None else self._loop.call_later(longest_s, self.event.set)
        try:
            await self.event.wait()
        finally:
            if timer is not None:
                timer.cancel()

    def send(self) -> None:
        """Set the event soon. While the loop is busy, further calls add nothing to its queue."""
        if not self._is_sent:
            self._is_sent = True
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._set)

    def _set(self) -> None:
        self._is_sent = False  # first: what comes from now on sets it again
        self.event.set()
