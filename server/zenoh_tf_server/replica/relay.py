"""The commit stream of one copy: what the replica has received, for the mirrors of its clients.

A message of the primary goes out once the copy has it, with the same numbers, changes and times.
So a mirror may follow now the primary and now a replica.

Thread safety: all methods; `apply` by one thread.
"""

from __future__ import annotations

import functools
import logging
import threading
import time

import zenoh

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._core import InterestReader
from zenoh_tf._net import keys
from zenoh_tf.mirrors.feed import MirrorFeed

from ..limits import Limits
from ..streams.publisher import HEARTBEAT_S, StreamPublisher

log = logging.getLogger("zenoh_tf.server")


class Relay:
    """Publishes the changes of one copy of the primary's tree; a `CommitStream`."""

    def __init__(
        self, feed: MirrorFeed, tree: TransformTree, instance: str, limits: Limits
    ) -> None:
        self._feed = feed
        self._tree = tree
        self._instance = instance
        # Not the own method: a relay that is closed goes at once, with its tree.
        ahead = functools.partial(feed.clock.real_ahead_ns, instance)
        self._publisher = StreamPublisher(instance, limits.stream_bytes, ahead)
        self._lock = threading.Lock()  # of the messages, and the next two
        self._applied = 0  # the last number of a message that the copy has
        self._is_active = False
        self._changed = threading.Event()  # the listeners, or `_closing`
        self._active = threading.Event()
        self._closing = False
        self._thread: threading.Thread | None = None

    def start(self, session: zenoh.Session, tree: str) -> None:
        """Publish to whoever listens to the stream of a tree."""
        self._publisher.start(session, keys.stream(tree, self._instance), self._changed.set)
        self._thread = threads.start("relay", self._run)

    def close(self) -> None:
        """Publish no more."""
        self._closing = True
        self._changed.set()
        threads.join(self._thread)
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

    def wait_until_active(self, timeout_s: float) -> None:
        """As `CommitStream.wait_until_active`."""
        if not self._active.is_set() and self._publisher.has_listeners():
            self._active.wait(timeout_s)

    def position(self) -> tuple[int, int]:
        """As `CommitStream.position`."""
        state = self._feed.state
        if state.tree is not self._tree:  # it is about to be, or was
            return self._applied, 0
        return max(self._applied, state.seq), state.clock_ns

    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        """As `CommitStream.read`."""
        with self._feed.paused():  # else a change could be there before its number
            seq, clock_ns = self.position()
            _, reparented, changes, everything = reader.read(with_all, max_frames)
        return (seq, reparented, changes, everything), clock_ns

    def last_seq(self) -> int:
        """As `CommitStream.last_seq`."""
        mirroring = self._feed.mirroring
        reach = mirroring.reach_seq if mirroring.tree is self._tree else 0
        return max(self.position()[0], reach)

    def missed(self, first: int) -> wire.Message:
        """As `CommitStream.missed`."""
        return self._publisher.missed(first, self._publisher.last)

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {
            "stream_messages": self._publisher.messages,
            "stream_message_bytes": self._publisher.bytes,
            "stream_kept_bytes": self._publisher.recent.bytes,
        }

    def real_ahead_ns(self) -> int | None:
        """As `CommitStream.real_ahead_ns`."""
        return self._feed.clock.real_ahead_ns(self._instance)

    # --- the thread

    def _run(self) -> None:
        while not self._closing:
            self._changed.clear()
            try:
                if self._publisher.has_listeners():
                    self._beat()
                    self._changed.wait(HEARTBEAT_S)
                else:
                    self._end()
                    self._changed.wait()
            except Exception:  # the stream must continue
                log.exception("internal error in the stream of a copy")
                time.sleep(HEARTBEAT_S)

    def _beat(self) -> None:
        """Begin to publish, or put a heartbeat, whose number is also of commits without changes."""
        with self._lock:
            if self._feed.state.tree is not self._tree:  # not yet, or not any more
                return
            last, clock_ns = self.position()
            self._is_active = True
            self._publisher.put(max(self._publisher.last, last), clock_ns, None)
        self._active.set()

    def _end(self) -> None:
        with self._lock:
            self._is_active = False
            self._active.clear()
            self._publisher.recent.clear()
