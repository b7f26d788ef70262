"""Turns what a robot's server tells into puts for this server's tree.

The names of a message are examined once, and the rest is done with whole columns: a first copy may
have 100,000 frames.

Thread safety: none; the robot's feed locks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import TransformException
from zenoh_tf.recordings.blocks import Block, commits, slice_rows, take_rows, with_own_names
from zenoh_tf.ros2.cdr import TfMessage
from zenoh_tf.wire.stream import CLEARED, NO_PARENT, REMOVED, STATIC

from ..ingest.prefixes import Prefixes
from ..ingest.put_queues import Put
from .quota import FrameQuota

#: Rows of one put: about 80 kB.
_MAX_ROWS: Final = 1024
#: Frames of one put of a first copy. If it is refused, each of them is a transaction of its own.
_MAX_FRAMES: Final = 128

#: Is told of refused rows: an authority, how many, and why.
Refuse = Callable[[str, int, TransformException], None]


class Rows:
    """The puts of one robot."""

    def __init__(
        self,
        name: str,
        shared: tuple[str, ...],
        max_rows: int,
        quota: FrameQuota,
        refuse: Refuse,
    ) -> None:
        """`name`: the prefix of its frames and authorities. `shared`: frames without a prefix."""
        self._name = name
        self._begin = f"{name}/"
        self._rename = Prefixes((), shared).renamer(name)
        self._max_rows = min(max_rows, _MAX_ROWS)
        self._quota = quota
        self._refuse = refuse
        self.received = 0  # samples
        self.left_out = 0  # samples of shared frames
        self.over_quota = 0  # samples of frames above its share
        self.removals = 0  # frames that the robot has cleared or removed

    def of_frames(self, frames: wire.Frames) -> Iterator[Put]:
        """Puts of frames with their histories, many frames in each. If one is refused, its frames
        are committed one by one: so one that cannot be stored here keeps no other one back."""
        names, authorities, frame, _, static, authority, count, stamp, parent, pose = frames
        rows = TfMessage(self._rename(names), parent, np.repeat(frame, count), stamp, pose)
        columns = self._taken(
            rows, authorities, np.repeat(authority, count), np.repeat(static != 0, count)
        )
        order = np.lexsort((columns.static, columns.authority))  # stable: a frame's rows stay
        yield from self._puts(columns.take(order), authorities, each_frame=True)

    def of_changes(self, changes: wire.Changes) -> Iterator[Put]:
        """Puts of a message of the stream: what each authority has committed."""
        names, authorities, kind, frame, _, parent, authority, stamp, pose, _ = changes
        self.removals += int(np.isin(kind, (CLEARED, REMOVED)).sum())
        has_sample = kind <= STATIC
        rows = TfMessage(self._rename(names), parent, frame[has_sample], stamp, pose)
        columns = self._taken(rows, authorities, authority, kind[has_sample] == STATIC)
        order = np.argsort(columns.authority, kind="stable")
        yield from self._puts(columns.take(order), authorities, each_frame=False)

    def _taken(
        self,
        rows: TfMessage,
        authorities: list[str],
        authority: NDArray[np.uint32],
        static: NDArray[np.bool_],
    ) -> _Columns:
        """The rows that this tree takes; counts all others."""
        self.received += len(rows.stamp)
        names = len(rows.names)
        is_own = np.fromiter((name.startswith(self._begin) for name in rows.names), bool, names)
        may = is_own[rows.child]
        self.left_out += int(np.count_nonzero(~may))
        # A sample whose parent was removed has none.
        taken = np.flatnonzero(may & (rows.parent != NO_PARENT))
        columns = _Columns(take_rows(rows, taken), authority[taken], static[taken])
        admitted = self._quota.admit(
            rows.names, columns.rows.parent, columns.rows.child, counted=is_own
        )
        if admitted.all():
            return columns
        self._refuse_rows(columns.take(np.flatnonzero(~admitted)), authorities)
        return columns.take(np.flatnonzero(admitted))

    def _refuse_rows(self, columns: _Columns, authorities: list[str]) -> None:
        """Count rows of frames above the quota."""
        self.over_quota += len(columns.static)
        rows = columns.rows
        each, first, count = np.unique(columns.authority, return_index=True, return_counts=True)
        for authority, row, refused in zip(
            each.tolist(), first.tolist(), count.tolist(), strict=True
        ):
            error = self._quota.exceeded(rows.names[int(rows.child[row])])
            self._refuse(f"{self._name}:{authorities[authority]}", refused, error)

    def _puts(
        self, columns: _Columns, authorities: list[str], *, each_frame: bool
    ) -> Iterator[Put]:
        """Puts of rows that are sorted by authority."""
        rows, authority, static = columns
        # Split where static and dynamic rows meet: a link may be the one and then the other.
        meet = np.flatnonzero((np.diff(authority) != 0) | (np.diff(static) != 0)) + 1
        bounds = [0, *meet.tolist(), len(static)]
        now_ns = time.time_ns()
        for begin, end in pairwise(bounds):
            if begin == end:
                continue
            name = f"{self._name}:{authorities[int(authority[begin])]}"
            is_static = bool(static[begin])
            run = with_own_names(slice_rows(rows, begin, end))
            for block in commits(Block(run, is_static, 1)):
                for part in self._parts(block.rows, each_frame):
                    payload = wire.pack(wire.commit_body(wire.Commit(TransformRows(*part))))
                    put = Put(name, is_static, payload, len(payload), now_ns)
                    if each_frame:
                        put.parts = _one_by_one
                    yield put

    def _parts(self, rows: TfMessage, each_frame: bool) -> Iterator[TfMessage]:
        """The rows of each put; of some frames if `each_frame`, whose rows stand together."""
        count = len(rows.stamp)
        ends = np.append(np.flatnonzero(np.diff(rows.child)) + 1, count)  # of the frames
        begin = 0
        while begin < count:
            end = min(begin + self._max_rows, count)
            if each_frame:
                last = int(np.searchsorted(ends, begin, "right")) + _MAX_FRAMES - 1
                end = min(end, int(ends[min(last, len(ends) - 1)]))
            yield with_own_names(slice_rows(rows, begin, end))
            begin = end


class _Columns(NamedTuple):
    """Rows with what a message has beside them."""

    rows: TfMessage
    authority: NDArray[np.uint32]  # (n,)
    static: NDArray[np.bool_]  # (n,)

    def take(self, which: NDArray[np.intp]) -> _Columns:
        return _Columns(take_rows(self.rows, which), self.authority[which], self.static[which])


def _one_by_one(put: Put) -> list[Put]:
    """A put for each frame of one that was refused."""
    commit = wire.parse_commit(wire.unpack(put.payload))
    whole = commit.rows
    rows = TfMessage(whole.names, whole.parent, whole.child, whole.stamp, whole.pose)
    bounds = [0, *(np.flatnonzero(np.diff(rows.child)) + 1).tolist(), len(rows.stamp)]
    found = []
    for begin, end in pairwise(bounds):
        part = with_own_names(slice_rows(rows, begin, end))
        payload = wire.pack(wire.commit_body(wire.Commit(TransformRows(*part))))
        found.append(Put(put.authority, put.static, payload, len(payload), put.arrival_ns))
    return found
