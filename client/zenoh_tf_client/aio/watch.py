"""`AsyncWatch`: follows the pose of a pair of frames."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from typing import Self

from zenoh_tf.errors import ServerUnavailable, TimeoutException
from zenoh_tf.text import quoted

from ..mirror.base_mirror import BaseMirror
from ..mirror.watching import PoseEvent, Terms, Watching
from ..session.calls import raise_if_forked
from .session.threads import in_thread
from .session.wake import Alarm


class AsyncWatch:
    """Reports how the pose of a pair of frames changes; made by `AsyncTransformClient.watch`.

    The server pushes the changes into a mirror of the pair, and does its part once for all who
    watch the same pair at the same rate. Nothing queues up: each event is made when it is read,
    and has the newest pose. An asynchronous context manager, which closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop. Each event goes to one of
    the tasks that wait.

    Example:
        ``async for event in watch: print(event.reason, event.pose, event.age_s)``

    Attributes:
        target: The frame to express the pose in.
        source: The frame whose pose is followed.
    """

    def __init__(self, mirror: BaseMirror, target: str, source: str, terms: Terms) -> None:
        """Use `AsyncTransformClient.watch` instead."""
        self.target = target
        self.source = source
        self._mirror = mirror
        self._watching = Watching(mirror, target, source, terms)
        if True:  # asynchronous
            alarm = Alarm()  # the feed must not keep the watch alive
            self._changed = alarm.event
            mirror._feed.on_change = alarm.send

    def __repr__(self) -> str:
        state = "closed" if self._mirror._feed.closed else "open"
        return f"<AsyncWatch of {quoted(self.source)} in {quoted(self.target)}, {state}>"

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def __aiter__(self) -> AsyncIterator[PoseEvent]:
        """Iterate over events, until the watch or its client is closed."""
        while not self._mirror._feed.closed:
            if event := await self._next(None):
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
        event = await self._next(timeout_s)
        if event is not None:
            return event
        if self._mirror._feed.closed:
            raise ServerUnavailable("the watch is closed")
        raise TimeoutException(f"the pose has not changed within {timeout_s:g} s")

    async def close(self) -> None:
        """Stop following. Iterations end, and `get` raises an error. May be called again."""
        await in_thread(self._mirror._end)

    async def _next(self, timeout_s: float | None) -> PoseEvent | None:
        """The next event; None if there is none in time, or at the end."""
        raise_if_forked()
        feed, watching = self._mirror._feed, self._watching
        if True:  # asynchronous
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(timeout_s):
                    while not feed.closed:
                        # First: what comes from now on wakes this task again. Other tasks that
                        # wait were woken with it.
                        self._changed.clear()
                        if event := watching.next_event():
                            return event
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(watching.heartbeat_in_s):
                                await self._changed.wait()
            return None
        else:
            deadline_s = float("inf") if timeout_s is None else time.monotonic() + timeout_s
            found: PoseEvent | None = None

            def is_found() -> bool:  # under the feed's lock: one thread at a time
                nonlocal found
                found = found or watching.next_event()
                return found is not None

            while not feed.wait(
                is_found, min(watching.heartbeat_in_s, deadline_s - time.monotonic())
            ):
                if feed.closed or time.monotonic() >= deadline_s:
                    return None
            return found
