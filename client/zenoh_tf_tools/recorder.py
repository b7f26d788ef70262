"""`Recorder`: writes every sample that a server commits into a file.

It listens as a mirror does, and records what the mirror's copy is made of: a snapshot with the
static links and the history that the server has, then every commit's samples. The feed's thread
only puts them into a queue; a thread of the recorder writes them, and flushes the file twice a
second. Commits that the snapshot shows already come after it once more, and are left out. After a
gap in the stream, or when the server is another, the feed takes a new snapshot, and so does the
file: samples that are recorded twice change no answer.

    MirrorFeed ──> Recorder.begin, load, apply ──> queue ──> thread ──> RecordingWriter

Thread safety: all methods; `begin`, `load` and `apply` are the feed's.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformTree, threads, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.recordings.writer import RecordingWriter
from zenoh_tf.wire.samples import CLEARED, REMOVED, STATIC
from zenoh_tf_client.client import TransformClient
from zenoh_tf_client.mirror.source import MirrorSource

#: Most bytes of samples that wait for the disk. What comes then is dropped and counted.
_MAX_QUEUE_BYTES: Final = 256 << 20
#: What is written is handed to the system this often.
_FLUSH_S: Final = 0.5
#: Samples of a snapshot in one message.
_SNAPSHOT_ROWS: Final = 200
#: Samples of a snapshot are recorded as this old at most: their stamps may be of another clock.
_MAX_AGE_NS: Final = 3600 * 10**9
#: From here on, stamps as old as that are of 64 bits, too.
_FIRST_NEWEST_NS: Final = -(1 << 63) + _MAX_AGE_NS


@dataclass(slots=True)
class Counters:
    """What became of the samples. Only the recorder changes it."""

    messages: int = 0
    transforms: int = 0  # dynamic samples, also those recorded twice
    static: int = 0
    dropped: int = 0  # samples that came while the queue was full
    unrepresentable: int = 0  # samples that the file's format cannot hold
    removals: int = 0  # frames removed or cleared, which no recording can say
    missed_commits: int = 0  # between the stream and a new snapshot, at most
    servers: int = 0  # instances seen


class _Item(NamedTuple):
    """A message to write."""

    log_ns: int
    static: bool
    rows: TransformRows


class Recorder:
    """Records a client's tree from construction until `close`."""

    def __init__(self, client: TransformClient, writer: RecordingWriter) -> None:
        """Begin to record. Raises ServerUnavailable if the client is closed."""
        self.counters = Counters()
        self._writer = writer
        self._queue: deque[_Item] = deque()  # guarded by `_changed`, as are the next three
        self._queued_bytes = 0
        self._closing = False
        self._error: Exception | None = None
        self._changed = threading.Condition()
        # Guarded by the feed's lock.
        self._instance = ""
        self._seq = 0  # of the last commit that is recorded
        self._plan: tuple[str, int] | None = None  # instance and number of an unfinished snapshot
        self._snapshot: list[bytes] = []  # its pieces
        #: Of its frames, until the stream is as new as the newest of them.
        self._versions: dict[str, int] = {}
        self._thread = threads.start("recorder", self._write)
        self._feed = MirrorFeed(MirrorSource(client.connection), self._on_copy, observer=self)

    # --- what its owner calls

    @property
    def error(self) -> Exception | None:
        """Why nothing is written any more, such as a full disk; None while all is well."""
        return self._error

    def wait_for_copy(self, timeout_s: float) -> None:
        """Wait until the server's history is queued. Raises as `MirrorFeed.wait_for_copy`."""
        self._feed.wait_for_copy(timeout_s)

    def age_s(self) -> float:
        """How long the server has been silent, in seconds."""
        return self._feed.age_s()

    def close(self) -> None:
        """Record no more, write what waits, and end the file. Raises what writing raised."""
        self._feed.close()
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()
        if self._error is not None:
            self._writer.abandon()
            raise self._error
        self._writer.close()

    # --- what the feed calls, under its lock; see `mirrors.copy.Observer`

    def begin(self, instance: str, seq: int) -> None:
        """A new snapshot begins; one that was not complete is given up."""
        self._plan, self._snapshot = (instance, seq), []

    def load(self, frames: bytes) -> None:
        """Keep frames until the snapshot is complete: static links are recorded first."""
        self._snapshot.append(frames)

    def apply(self, message: wire.StreamMessage) -> None:
        """Queue the samples of a message, and count what a recording cannot say."""
        self._end_snapshot()
        self._seq = max(self._seq, message.last)
        assert message.changes is not None
        changes = wire.Changes(message.changes)
        is_new = self._is_new(changes, message.last)
        self.counters.removals += int((is_new & np.isin(changes.kind, (CLEARED, REMOVED))).sum())
        samples = wire.samples_of_changes(changes)
        chosen = np.flatnonzero(samples.has_parent & is_new[changes.kind <= STATIC])
        rows, static = samples.rows(chosen), samples.static[chosen]
        log_ns = time.time_ns()
        # Split where static and dynamic samples meet: a link may be the one and then the other.
        bounds = [0, *(np.flatnonzero(np.diff(static)) + 1).tolist(), len(static)]
        for begin, end in pairwise(bounds):
            if begin < end:
                item = _Item(log_ns, bool(static[begin]), rows[begin:end])
                self._put(item, may_wait=False)

    def _is_new(self, changes: wire.Changes, last: int) -> NDArray[np.bool_]:
        """(n,) False for changes, of commits up to `last`, that the snapshot shows already."""
        if not self._versions:
            return np.ones(len(changes.version), np.bool_)
        have = np.array([self._versions.get(name, 0) for name in changes.names], np.uint64)
        if last >= max(self._versions.values()):
            self._versions.clear()
        return changes.version > have[changes.frame]

    def _on_copy(self, tree: TransformTree | None, instance: str) -> None:
        """The feed has a new copy of the tree, so the snapshot is complete; None at the end."""
        if tree is not None:
            self._end_snapshot()

    def _end_snapshot(self) -> None:
        """Queue a snapshot: static links first, then the histories by their stamps."""
        if self._plan is None:
            return
        instance, seq = self._plan
        is_first = not self._instance
        if instance != self._instance:
            self.counters.servers += 1
        else:
            self.counters.missed_commits += max(0, seq - self._seq)
        self._instance, self._seq, self._plan = instance, seq, None
        frames, self._snapshot = [wire.Frames(piece) for piece in self._snapshot], []
        self._versions = {
            each.names[name]: version
            for each in frames
            for name, version in zip(each.frame.tolist(), each.version.tolist(), strict=True)
        }
        if not frames:
            return
        static, histories = _rows_of(frames)
        count = len(histories)
        times = np.full(count, time.time_ns())
        if is_first:
            # As if it had been recorded when it happened, so that it is played again so.
            # Clipped first: the difference of two stamps may need more than 64 bits.
            newest_ns = int(histories.stamp.max(initial=_FIRST_NEWEST_NS))
            times -= newest_ns - np.maximum(histories.stamp, newest_ns - _MAX_AGE_NS)
        first_ns = int(times[0]) if count else time.time_ns()
        self._put(_Item(first_ns, True, static), may_wait=True)
        for begin in range(0, count, _SNAPSHOT_ROWS):
            end = min(begin + _SNAPSHOT_ROWS, count)
            self._put(_Item(int(times[end - 1]), False, histories[begin:end]), may_wait=True)

    def _put(self, item: _Item, *, may_wait: bool) -> None:
        """Queue a message, or count it as dropped if there is no room. A snapshot has room: it is
        no larger than the copy of the tree."""
        count = len(item.rows)
        if not count:
            return
        with self._changed:
            if self._error is not None:
                return
            size = item.rows.nbytes
            if not may_wait and self._queued_bytes + size > _MAX_QUEUE_BYTES:
                self.counters.dropped += count
                return
            self._queue.append(item)
            self._queued_bytes += size
            self._changed.notify_all()

    # --- the thread that writes

    def _write(self) -> None:
        flush_at_s = time.monotonic() + _FLUSH_S
        is_flushed = True
        try:
            while True:
                with self._changed:
                    wait_s = None if is_flushed else max(0.0, flush_at_s - time.monotonic())
                    self._changed.wait_for(lambda: self._queue or self._closing, wait_s)
                    if self._closing and not self._queue:
                        return
                    item = self._queue.popleft() if self._queue else None
                    if item is not None:
                        self._queued_bytes -= item.rows.nbytes
                if item is not None:
                    if is_flushed:
                        flush_at_s = time.monotonic() + _FLUSH_S
                        is_flushed = False
                    self._write_rows(item)
                if time.monotonic() >= flush_at_s and not is_flushed:
                    self._writer.flush()
                    is_flushed = True
        except Exception as error:
            with self._changed:
                self._error = error
                self._queue.clear()

    def _write_rows(self, item: _Item) -> None:
        """Write a message without the samples that the format cannot hold."""
        count = len(item.rows)
        try:
            self._writer.write(*item)
        except InvalidArgumentException:
            if count == 1:
                self.counters.unrepresentable += 1
                return
            for begin, end in pairwise((0, count // 2, count)):
                self._write_rows(item._replace(rows=item.rows[begin:end]))
            return
        self.counters.messages += 1
        self.counters.transforms += 0 if item.static else count
        self.counters.static += count if item.static else 0


def _rows_of(snapshot: list[wire.Frames]) -> tuple[TransformRows, TransformRows]:
    """The static links of a snapshot, and all other samples by their stamps."""
    static: list[TransformRows] = []
    dynamic: list[TransformRows] = []
    for frames in snapshot:
        samples = wire.samples_of_frames(frames)
        for parts, chosen in ((static, samples.static), (dynamic, ~samples.static)):
            parts.append(samples.rows(np.flatnonzero(samples.has_parent & chosen)))
    histories = TransformRows.join(dynamic)
    return TransformRows.join(static), histories[np.argsort(histories.stamp, kind="stable")]
