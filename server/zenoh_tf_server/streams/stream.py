"""The commit stream: publishes what commits change, while someone listens.

One thread reads the entries of the tree's change log and puts each batch as one message. A commit
that comes alone goes out at once; after a message, the next one waits for a millisecond and then
has everything. Without changes, a heartbeat has the last number. The publisher drops what a
link does not accept: so no listener delays the server or another listener, and those that miss a
message ask for it (docs/explanation/decisions/0010-changes-carry-versions.md).

Thread safety: all methods.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections.abc import Callable
from operator import attrgetter
from typing import Final

import zenoh

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._core import ChangeLog, InterestReader
from zenoh_tf._net import keys

from ..limits import Limits
from .publisher import HEARTBEAT_S, StreamPublisher

log = logging.getLogger("zenoh_tf.server")

#: The least time between two messages.
_INTERVAL_S: Final = 0.001
#: A message has entries until they have this many bytes; one commit is never split. Zenoh queues
#: 1 MB for each link, and drops a message for which there is no room.
_MESSAGE_BYTES: Final = 1 << 18


class Stream:
    """Publishes a tree's changes."""

    def __init__(self, tree: TransformTree, instance: str, limits: Limits) -> None:
        self._instance = instance
        self._log = ChangeLog(tree)
        #: The number of the tree's last commit, which may be in progress. In C, as each reply to a
        #: write has it.
        self.last_seq: Callable[[], int] = functools.partial(attrgetter("last"), self._log)
        self._publisher = StreamPublisher(instance, limits.stream_bytes, self.real_ahead_ns)
        self._changed = threading.Event()  # the listeners, or `_closing`
        self._active = threading.Event()  # the log is read
        self._closing = False
        self._clock_ns = 0  # of the last message
        self._gaps = 0
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

    def position(self) -> tuple[int, int]:
        """As `CommitStream.position`."""
        clock_ns = time.monotonic_ns()  # in this order
        return self._log.last, clock_ns

    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        """As `CommitStream.read`."""
        clock_ns = time.monotonic_ns()  # in this order
        return reader.read(with_all, max_frames), clock_ns

    def missed(self, first: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on."""
        return self._publisher.missed(first, self._publisher.last)

    def real_ahead_ns(self) -> int:
        """As `CommitStream.real_ahead_ns`."""
        return time.time_ns() - time.monotonic_ns()

    def counters(self) -> dict[str, int]:
        """Counters for `stats`."""
        return {
            "stream_messages": self._publisher.messages,
            "stream_message_bytes": self._publisher.bytes,
            "stream_gaps": self._gaps,
            "stream_kept_bytes": self._publisher.recent.bytes,
            "change_log_bytes": self._log.nbytes,
        }

    def _wake(self) -> None:
        self._changed.set()
        self._log.wake()

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

    def _publish(self) -> None:
        """Publish until nobody listens any more."""
        self._begin()
        try:
            while not self._closing:
                if self._changed.is_set():
                    self._changed.clear()
                    if not self._publisher.has_listeners():
                        break
                self._log.wait(HEARTBEAT_S)
                self._put_changes()
                time.sleep(_INTERVAL_S)
        finally:
            self._active.clear()
            self._log.stop()
            self._publisher.recent.clear()

    def _begin(self) -> None:
        """Continue with the next commit. Listeners see a gap if they know of an earlier one."""
        self._publisher.recent.clear()
        self._clock_ns = time.monotonic_ns()  # not later than the number, see `_put_changes`
        self._publisher.last = self._log.start()
        self._active.set()
        self._publisher.put(self._publisher.last, self._clock_ns, None)

    def _put_changes(self) -> None:
        """Put what there is, or a heartbeat if its time has come."""
        # Mirrors compute their age from the clock: what was committed before must be in this
        # message or an earlier one, so the clock waits for commits in progress.
        clock_ns, assigned = time.monotonic_ns(), self._log.last
        _, last, lost, changes = self._log.take(_MESSAGE_BYTES)
        if last >= assigned:
            self._clock_ns = clock_ns
        publisher = self._publisher
        if last > publisher.last or time.monotonic() - publisher.put_s >= HEARTBEAT_S:
            publisher.put(last, self._clock_ns, changes)
        if lost:
            self._gaps += 1
            self._begin()
