"""`TreeObserver`: sees every sample that a server commits, for the doctor.

It listens as a mirror does: first a snapshot with the static links and the history that the server
has, then every commit's samples, each with the server's clock when it was sent.

    MirrorFeed ──> TreeObserver.begin, load, apply ──> queue ──> update ──> Observation

Thread safety: `update` and what it fills belong to one thread; `begin`, `load` and `apply` are the
feed's.
"""

from __future__ import annotations

import math
import time
from collections import deque
from itertools import pairwise
from typing import Final

import numpy as np

from zenoh_tf import TransformTree, wire
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf_client.client import TransformClient
from zenoh_tf_client.mirror.source import MirrorSource
from zenoh_tf_tools.doctor import Observation

#: How often it is asked whether the clocks have been compared.
_PAUSE_S: Final = 0.01


class TreeObserver:
    """Observes a client's tree from construction until `close`."""

    def __init__(self, client: TransformClient, timeout_s: float) -> None:
        """Begin to observe, and wait for what the server has.

        Raises:
            TransformException: Those that `MirrorFeed.wait_for_copy` lists.
        """
        self.observation = Observation()
        self._timeout_s = timeout_s
        self._has_copy = False
        self._queue: deque[bytes | wire.StreamMessage] = deque()
        source = MirrorSource(client.connection)
        self._feed = MirrorFeed(source, self._on_copy, observer=self, keeps_tree=False)
        try:
            self._feed.wait_for_copy(timeout_s)
        except BaseException:
            self.close()
            raise
        #: This machine's real-time clock less the clock of the stream, which may be any.
        self._offset_ns = self._compare_clocks()
        self._snapshots = self._feed.snapshots
        self.update()

    def update(self) -> int:
        """Add what has come to `observation`, and return up to when, in nanoseconds."""
        while self._queue:
            item = self._queue.popleft()
            if isinstance(item, wire.StreamMessage):
                self._add(item)
            else:
                self._load(item)
        return self._feed.state.clock_ns + self._offset_ns

    @property
    def is_broken(self) -> bool:
        """Whether another snapshot was needed: of another server, or since messages were lost."""
        return self._feed.snapshots != self._snapshots

    def renew(self) -> None:
        """Judge what comes from now on."""
        self.update()
        self.observation.renew()
        self._offset_ns = self._compare_clocks()  # they drift

    def close(self) -> None:
        """Observe no more."""
        self._feed.close()

    def _compare_clocks(self) -> int:
        end_s = time.monotonic() + self._timeout_s
        while True:
            state = self._feed.state
            age_s = self._feed.age_s(state)
            if math.isfinite(age_s) or time.monotonic() > end_s:
                age_ns = round(age_s * 1e9) if math.isfinite(age_s) else 0
                return time.time_ns() - state.clock_ns - age_ns
            time.sleep(_PAUSE_S)

    # --- what the feed calls, under its lock; see `mirrors.copy.Observer`

    def begin(self, instance: str, seq: int) -> None:
        """A snapshot begins. Only the first is of use: what a later one has was seen, or is of no
        known arrival."""
        if not self._has_copy:
            self._queue.clear()

    def load(self, frames: bytes) -> None:
        """Queue frames of the first snapshot."""
        if not self._has_copy:
            self._queue.append(frames)

    def apply(self, message: wire.StreamMessage) -> None:
        """Queue a message."""
        self._has_copy = True
        self._queue.append(message)

    def _on_copy(self, tree: TransformTree | None, instance: str) -> None:
        """The snapshot is complete. Its tree is not read: the records are the server's."""
        self._has_copy = True

    # --- what `update` does

    def _load(self, frames: bytes) -> None:
        samples = wire.samples_of_frames(wire.Frames(frames))
        bounds = np.flatnonzero(np.diff(samples.child, prepend=-1, append=-1)).tolist()
        for begin, end in pairwise(bounds):
            first = end - 1  # of the samples with the newest parent
            while first > begin and samples.parent[first - 1] == samples.parent[end - 1]:
                first -= 1
            if not samples.has_parent[first]:
                continue
            child, parent = (
                samples.names[column[first]] for column in (samples.child, samples.parent)
            )
            if samples.static[first]:
                authority = samples.authorities[samples.authority[first]]
                self.observation.add(
                    None, child, parent, 0, samples.pose[first], authority, static=True
                )
            else:
                self.observation.load(
                    child, parent, samples.stamp[first:end], samples.pose[first:end]
                )

    def _add(self, message: wire.StreamMessage) -> None:
        assert message.changes is not None
        samples = wire.samples_of_changes(wire.Changes(message.changes))
        arrival_ns = message.clock_ns + self._offset_ns
        columns = (samples.has_parent, samples.child, samples.parent, samples.stamp)
        rows = zip(
            *(column.tolist() for column in (*columns, samples.authority, samples.static)),
            samples.pose,
            strict=True,
        )
        for has_parent, child, parent, stamp_ns, authority, static, pose in rows:
            if has_parent:
                self.observation.add(
                    arrival_ns,
                    samples.names[child],
                    samples.names[parent],
                    stamp_ns,
                    pose,
                    samples.authorities[authority],
                    static=bool(static),
                )
