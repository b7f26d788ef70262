"""`Watch`: follows the pose of a pair of frames."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Iterator
from typing import TYPE_CHECKING

from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import ServerUnavailable, TimeoutException
from zenoh_tf.loop_waits import LoopWaits
from zenoh_tf.text import quoted

from .mirror import Mirror
from .watching import PoseEvent, Terms, Watching

if TYPE_CHECKING:
    from typing_extensions import Self


class Watch:
    """Reports how the pose of a pair of frames changes; made by `TransformClient.watch`.

    The server pushes the changes into a mirror of the pair, and does its part once for all who
    watch the same pair at the same rate. Nothing queues up: each event is made when it is read,
    and has the newest pose. A context manager, which closes itself at the end.

    Thread safety: all methods. Each event goes to one of the threads or tasks that wait. An event
    loop iterates with ``async for``.

    Example:
        ``for event in watch: print(event.reason, event.pose, event.age_s)``

    Attributes:
        target: The frame to express the pose in.
        source: The frame whose pose is followed.
    """

    def __init__(self, mirror: Mirror, target: str, source: str, terms: Terms) -> None:
        """Use `TransformClient.watch` instead."""
        self.target = target
        self.source = source
        self._mirror = mirror
        self._watching = Watching(mirror, target, source, terms)
        self._loops = LoopWaits()
        mirror._feed.on_change = self._loops.wake  # the feed must not keep the watch alive

    def __repr__(self) -> str:
        state = "closed" if self._mirror._feed.closed else "open"
        return f"<Watch of {quoted(self.source)} in {quoted(self.target)}, {state}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[PoseEvent]:
        """Iterate over events, until the watch or its client is closed."""
        while not self._mirror._feed.closed:
            if event := self._next(None):
                yield event

    def __aiter__(self) -> AsyncIterator[PoseEvent]:
        """Iterate on an event loop, until the watch or its client is closed."""
        return self._loops.events(
            lambda: self._next(0.0),
            lambda: self._mirror._feed.closed,
            lambda: self._watching.heartbeat_in_s,
        )

    def get(self, timeout_s: float | None = None) -> PoseEvent:
        """Return the next event: at once, if the pose has changed enough since the last one.

        The first one is `"found"` or `"lost"`.

        Args:
            timeout_s: How long to wait for it, in seconds; None: until there is one, which is after
                `heartbeat_s` at the latest.

        Raises:
            TimeoutException: There was none in time.
            ServerUnavailable: The watch or its client is closed.
        """
        event = self._next(timeout_s)
        if event is not None:
            return event
        if self._mirror._feed.closed:
            raise ServerUnavailable("the watch is closed")
        raise TimeoutException(f"the pose has not changed within {timeout_s:g} s")

    def close(self) -> None:
        """Stop following. Iterations end, and `get` raises an error. May be called again."""
        self._mirror.close()

    def _next(self, timeout_s: float | None) -> PoseEvent | None:
        """The next event; None if there is none in time, or at the end."""
        raise_if_forked()
        feed, watching = self._mirror._feed, self._watching
        deadline_s = float("inf") if timeout_s is None else time.monotonic() + timeout_s
        found: PoseEvent | None = None

        def is_found() -> bool:  # under the feed's lock: one thread at a time
            nonlocal found
            found = found or watching.next_event()
            return found is not None

        while not feed.wait(is_found, min(watching.heartbeat_in_s, deadline_s - time.monotonic())):
            if feed.closed or time.monotonic() >= deadline_s:
                return None
        return found
