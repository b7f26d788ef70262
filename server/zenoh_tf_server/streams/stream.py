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
import time
from operator import attrgetter
from typing import Final

from zenoh_tf import TransformTree
from zenoh_tf._core import ChangeLog, InterestReader

from ..limits import Limits
from .commit_stream import CommitStream
from .publisher import HEARTBEAT_S

#: The least time between two messages.
_INTERVAL_S: Final = 0.001
#: A message has entries until they have this many bytes; one commit is never split. Zenoh queues
#: 1 MB for each link, and drops a message for which there is no room.
_MESSAGE_BYTES: Final = 1 << 18


class Stream(CommitStream):
    """Publishes the changes of a server's own tree."""

    def __init__(self, tree: TransformTree, instance: str, limits: Limits) -> None:
        super().__init__(instance, limits, _real_ahead_ns)
        self._log = ChangeLog(tree)
        # The number may be of a commit in progress. In C, as each reply to a write has it.
        self.last_seq = functools.partial(attrgetter("last"), self._log)
        self._clock_ns = 0  # of the last message
        self._gaps = 0

    def position(self) -> tuple[int, int]:
        clock_ns = time.monotonic_ns()  # in this order
        return self._log.last, clock_ns

    def read(
        self, reader: InterestReader, with_all: bool, max_frames: int
    ) -> tuple[tuple[int, bool, bytes | None, bytes | None], int]:
        clock_ns = time.monotonic_ns()  # in this order
        return reader.read(with_all, max_frames), clock_ns

    def counters(self) -> dict[str, int]:
        own = {"stream_gaps": self._gaps, "change_log_bytes": self._log.nbytes}
        return super().counters() | own

    def _wake(self) -> None:
        super()._wake()
        self._log.wake()

    def _publish(self) -> None:
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


def _real_ahead_ns() -> int:
    return time.time_ns() - time.monotonic_ns()
