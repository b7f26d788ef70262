"""Turns what a robot's server tells into puts for this server's tree.

Thread safety: none; the robot's feed locks.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from zenoh_tf import wire
from zenoh_tf.recordings.blocks import Block, commits, take_rows, with_own_names
from zenoh_tf.ros2.cdr import TfMessage
from zenoh_tf.wire.stream import CLEARED, NO_PARENT, REMOVED, STATIC

from ..put_queues import Put
from ..ros2.prefixes import Prefixes

#: Rows of one put: about 80 kB.
_MAX_ROWS: Final = 1024


class Rows:
    """The puts of one robot."""

    def __init__(self, name: str, shared: tuple[str, ...], max_rows: int) -> None:
        """`name`: the prefix of its frames and authorities. `shared`: frames without a prefix."""
        self._name = name
        self._rename = Prefixes((), shared).renamer(name)
        self._max_rows = min(max_rows, _MAX_ROWS)
        self.received = 0  # samples
        self.left_out = 0  # samples of shared frames
        self.removals = 0  # frames that the robot has cleared or removed

    def of_frames(self, frames: wire.Frames) -> Iterator[Put]:
        """Puts of frames with their histories: each frame has its own, so that one which cannot be
        stored here keeps no other one back."""
        names, authorities, frame, _, static, authority, count, stamp, parent, pose = frames
        names = self._rename(names)
        bounds = [0, *np.cumsum(count).tolist()]
        for place, (begin, end) in enumerate(pairwise(bounds)):
            child = np.full(end - begin, frame[place], np.uint32)
            part = slice(begin, end)
            rows = TfMessage(names, parent[part], child, stamp[part], pose[part])
            yield from self._puts(authorities[authority[place]], bool(static[place]), rows)

    def of_changes(self, changes: wire.Changes) -> Iterator[Put]:
        """Puts of a message of the stream: what each authority has committed."""
        names, authorities, kind, frame, _, parent, authority, stamp, pose, _ = changes
        self.removals += int(np.isin(kind, (CLEARED, REMOVED)).sum())
        has_sample = kind <= STATIC
        all_rows = TfMessage(self._rename(names), parent, frame[has_sample], stamp, pose)
        static = kind[has_sample] == STATIC
        for each in np.unique(authority).tolist():
            chosen = np.flatnonzero(authority == each)
            # Split where static and dynamic rows meet: a link may be the one and then the other.
            meet = np.flatnonzero(np.diff(static[chosen])) + 1
            for part in np.split(chosen, meet):
                rows = take_rows(all_rows, part)
                yield from self._puts(authorities[each], bool(static[part[0]]), rows)

    def _puts(self, authority: str, static: bool, rows: TfMessage) -> Iterator[Put]:
        """Puts of one authority's rows."""
        self.received += len(rows.stamp)
        is_own = np.array([self._is_own(name) for name in rows.names], bool)
        may = is_own[rows.child] if len(rows.child) else np.zeros(0, bool)
        self.left_out += int(np.count_nonzero(~may))
        # A sample whose parent was removed has none.
        rows = with_own_names(take_rows(rows, np.flatnonzero(may & (rows.parent != NO_PARENT))))
        now_ns = time.time_ns()
        for block in commits(Block(rows, static, 1)):
            for begin in range(0, len(block.rows.stamp), self._max_rows):
                part = with_own_names(block.slice(begin, begin + self._max_rows).rows)
                payload = wire.pack(wire.commit_body(wire.Commit(*part)))
                yield Put(f"{self._name}:{authority}", static, payload, len(payload), now_ns)

    def _is_own(self, name: str) -> bool:
        return name.startswith(f"{self._name}/")
