"""The stream of a tree's changes: what a server's own tree and a replica's copy have in common."""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

import zenoh

from zenoh_tf import threads, wire
from zenoh_tf._core import InterestReader
from zenoh_tf._net import keys

from ..limits import Limits
from .publisher import HEARTBEAT_S, StreamPublisher

log = logging.getLogger("zenoh_tf.server")


class CommitStream(ABC):
    """Publishes a tree's changes, while someone listens. Thread safety: all methods."""

    #: Returns the number of a commit: what was read of the tree until now is of no later one.
    last_seq: Callable[[], int]

    def __init__(
        self, instance: str, limits: Limits, real_ahead_ns: Callable[[], int | None]
    ) -> None:
        """`real_ahead_ns`: by how much the server's real-time clock is ahead of its other; None if
        that is not known."""
        self._instance = instance
        self.real_ahead_ns = real_ahead_ns
        self._publisher = StreamPublisher(instance, limits.stream_bytes, real_ahead_ns)
        self._changed = threading.Event()  # the listeners, or `_closing`
        self._active = threading.Event()  # changes are published
        self._closing = False
        self._thread: threading.Thread | None = None

    def start(self, session: zenoh.Session, tree: str) -> None:
        """Publish to whoever listens to the stream of a tree."""
        self._publisher.start(session, keys.stream(tree, self._instance), self._wake)
        self._thread = threads.start("stream", self._run)

    def close(self) -> None:
        """Publish no more."""
        self._closing = True
        self._wake()
        threads.join(self._thread)

    def wait_until_active(self, timeout_s: float) -> None:
        """Wait until the changes are published, if someone listens."""
        if not self._active.is_set() and self._publisher.has_listeners():
            self._active.wait(timeout_s)

    @abstractmethod
    def position(self) -> tuple[int, int]:
        """The number of a commit, and a time of the server's clock: a read of the tree from now on
        sees that commit and all before it, and all that was committed before that time."""

    @abstractmethod
    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        """Read an interest: what `InterestReader.read` returns, and a time of the server's clock:
        all that was committed before it is in what was read."""

    def missed(self, first: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on."""
        return self._publisher.missed(first, self._publisher.last)

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {
            "stream_messages": self._publisher.messages,
            "stream_message_bytes": self._publisher.bytes,
            "stream_kept_bytes": self._publisher.recent.bytes,
        }

    @abstractmethod
    def _publish(self) -> None:
        """Publish until nobody listens any more, or `_closing`."""

    def _wake(self) -> None:
        self._changed.set()

    def _run(self) -> None:
        while not self._closing:
            self._changed.clear()
            try:
                if self._publisher.has_listeners():
                    self._publish()
                elif not self._closing:
                    self._changed.wait()
            except Exception:  # the stream must continue, with a gap
                log.exception("internal error in the commit stream")
                time.sleep(HEARTBEAT_S)
