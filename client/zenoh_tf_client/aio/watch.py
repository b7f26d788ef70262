"""`AsyncWatch`: follows the pose of a pair of frames, for asyncio."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Self

from zenoh_tf.errors import ServerUnavailable, TimeoutException
from zenoh_tf.text import quoted

from ..mirror.copy import MirrorCopy
from ..mirror.watching import PoseEvent, Terms, Watching
from .session.threads import in_thread


class AsyncWatch:
    """Tells how the pose of a pair of frames changes; made by `AsyncTransformClient.watch`.

    As `Watch`, on an event loop. An asynchronous context manager, which closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop. Each event goes to one of
    the tasks that wait.

    Example:
        ``async for event in watch: print(event.reason, event.pose, event.age_s)``

    Attributes:
        target: The frame to express the pose in.
        source: The frame whose pose is followed.
    """

    def __init__(self, mirror: MirrorCopy, target: str, source: str, terms: Terms) -> None:
        """Use `AsyncTransformClient.watch` instead."""
        self.target = target
        self.source = source
        self._mirror = mirror
        self._watching = Watching(mirror, target, source, terms)
        alarm = _Alarm()  # the feed must not keep the watch alive
        self._changed = alarm.event
        mirror._feed.on_change = alarm.send

    def __repr__(self) -> str:
        state = "closed" if self._mirror._feed.closed else "open"
        return f"<AsyncWatch of {quoted(self.source)} in {quoted(self.target)}, {state}>"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def __aiter__(self) -> AsyncIterator[PoseEvent]:
        """Iterate over events, until the watch or its client is closed."""
        while event := await self._next():
            yield event

    async def get(self, timeout_s: float | None = None) -> PoseEvent:
        """Return the next event: at once, if the pose has changed enough since the last one.

        The first one is `"found"` or `"lost"`.

        Args:
            timeout_s: How long to wait for it, in seconds; None: until there is one, which is after
                `heartbeat_s` at the latest.

        Raises:
            TimeoutException: There was none in time.
            ServerUnavailable: The watch or its client is closed.
        """
        try:
            async with asyncio.timeout(timeout_s):
                event = await self._next()
        except TimeoutError:
            raise TimeoutException(f"the pose has not changed within {timeout_s:g} s") from None
        if event is None:
            raise ServerUnavailable("the watch is closed")
        return event

    async def close(self) -> None:
        """Stop following. Iterations end, and `get` raises an error. May be called again."""
        await in_thread(self._mirror._end)

    async def _next(self) -> PoseEvent | None:
        """The next event; None at the end."""
        while not self._mirror._feed.closed:
            # Before the look: what comes from now on wakes this task again. Other tasks that wait
            # were woken with it.
            self._changed.clear()
            if event := self._watching.look():
                return event
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._watching.heartbeat_in_s):
                    await self._changed.wait()
        return None


class _Alarm:
    """Sets an event of the running loop from another thread."""

    def __init__(self) -> None:
        self.event = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._is_sent = False

    def send(self) -> None:
        """Set the event soon. While the loop is busy, further calls add nothing to its queue."""
        if not self._is_sent:
            self._is_sent = True
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._set)

    def _set(self) -> None:
        self._is_sent = False  # first: what comes from now on sets it again
        self.event.set()
