"""Lets event loops wait for what threads make: the asynchronous iterators of gates and watches."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Callable
from typing import TypeVar

T = TypeVar("T")


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
