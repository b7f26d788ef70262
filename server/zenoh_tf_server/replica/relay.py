"""The commit stream of one copy: what the replica has received, for the mirrors of its clients.

A message of the primary goes out once the copy has it, with the same numbers, changes and times.
So a mirror may follow now the primary and now a replica.

Thread safety: all methods; `apply` by one thread.
"""

from __future__ import annotations

import functools
import logging
import threading

import zenoh

from zenoh_tf import TransformTree, wire
from zenoh_tf._core import InterestReader
from zenoh_tf.mirrors.feed import MirrorFeed

from ..limits import Limits
from ..streams.commit_stream import CommitStream
from ..streams.publisher import HEARTBEAT_S

log = logging.getLogger("zenoh_tf.server")


class Relay(CommitStream):
    """Publishes the changes of one copy of the primary's tree."""

    def __init__(
        self, feed: MirrorFeed, tree: TransformTree, instance: str, limits: Limits
    ) -> None:
        # No method of its own: a relay that is closed goes at once, with its tree.
        super().__init__(instance, limits, functools.partial(feed.clock.real_ahead_ns, instance))
        self._feed = feed
        self._tree = tree
        self._lock = threading.Lock()  # of the messages, and the next two
        self._applied = 0  # the last number of a message that the copy has
        self._is_active = False

    def close(self) -> None:
        super().close()
        try:
            self._publisher.close()
        except zenoh.ZError as error:  # the session is closed
            log.debug("cannot undeclare the stream of a copy: %s", error)

    def apply(self, message: wire.StreamMessage) -> None:
        """Publish a message that the copy has, if someone listens."""
        with self._lock:
            self._applied = message.last
            if self._is_active:
                self._publisher.put(message.last, message.clock_ns, message.changes)

    def position(self) -> tuple[int, int]:
        state = self._feed.state
        if state.tree is not self._tree:  # it is about to be, or was
            return self._applied, 0
        return max(self._applied, state.seq), state.clock_ns

    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        with self._feed.paused():  # else a change could be there before its number
            seq, clock_ns = self.position()
            _, reparented, changes, everything = reader.read(with_all, max_frames)
        return (seq, reparented, changes, everything), clock_ns

    def last_seq(self) -> int:
        mirroring = self._feed.mirroring
        reach = mirroring.reach_seq if mirroring.tree is self._tree else 0
        return max(self.position()[0], reach)

    # --- the thread

    def _publish(self) -> None:
        try:
            while not self._closing:
                self._changed.clear()
                if not self._publisher.has_listeners():
                    break
                self._beat()
                self._changed.wait(HEARTBEAT_S)
        finally:
            with self._lock:
                self._is_active = False
                self._active.clear()
                self._publisher.recent.clear()

    def _beat(self) -> None:
        """Begin to publish, or put a heartbeat, whose number is also of commits without changes."""
        with self._lock:
            if self._feed.state.tree is not self._tree:  # not yet, or not any more
                return
            last, clock_ns = self.position()
            self._is_active = True
            self._publisher.put(max(self._publisher.last, last), clock_ns, None)
        self._active.set()
