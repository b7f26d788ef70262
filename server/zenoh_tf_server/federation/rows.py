"""Turns the stream of a robot's server into puts for this server's tree.

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
from zenoh_tf.wire.samples import CLEARED, REMOVED

from ..ingest.prefixes import Prefixes
from ..ingest.put_queues import Put
from .quota import FrameQuota

#: Rows of one put: about 80 kB.
_MAX_ROWS: Final = 1024
#: Frames of one put of a first copy: it keeps the locks of all of them.
_MAX_FRAMES: Final = 128

#: Called with refused rows: an authority, how many, and why.
Refuse = Callable[[str, int, TransformException], None]


class _Shape(NamedTuple):
    """A message that became one put, but for stamps and poses. A stream's messages are mostly like
    those before them; to find this out costs a twentieth of examining them."""

    key: object  # what is equal in messages of this shape
    names: list[str]  # in this tree
    parent: NDArray[np.uint32]
    child: NDArray[np.uint32]
    chosen: NDArray[np.intp]  # the numbers of the samples that are stored
    authority: str
    static: bool
    left_out: int


class RobotRows:
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
        self._last: _Shape | None = None

    def of_frames(self, frames: bytes) -> Iterator[Put]:
        """Puts of frames with their histories, many frames in each."""
        yield from self._of_copy(self._renamed(wire.samples_of_frames(wire.Frames(frames))))

    def of_changes(self, message: bytes, *, is_copy: bool = False) -> Iterator[Put]:
        """Puts of a message of the stream: what each authority has committed; with `is_copy`, all
        that there is of an interest, as `of_frames`."""
        changes = wire.Changes(message)
        kind, stamp, pose = changes.kind, changes.stamp, changes.pose
        columns = (kind, changes.frame, changes.parent, changes.authority)
        shape = tuple(column.tobytes() for column in columns)
        key = (changes.names, changes.authorities, shape, self._quota.generation)
        last = self._last
        if last is not None and last.key == key and not is_copy:
            self.received += len(stamp)
            self.left_out += last.left_out
            rows = TransformRows(
                last.names, last.parent, last.child, stamp[last.chosen], pose[last.chosen]
            )
            put = Put.of_rows(last.authority, last.static, rows, time.time_ns())
            put.is_relayed = True
            yield put
            return
        self.removals += int(np.isin(kind, (CLEARED, REMOVED)).sum())
        samples = self._renamed(wire.samples_of_changes(changes))
        if is_copy:
            yield from self._of_copy(samples)
            return
        left_out = self.left_out
        chosen = self._chosen(samples)
        chosen = chosen[np.argsort(samples.authority[chosen], kind="stable")]
        puts = list(self._puts(samples, chosen, each_frame=False))
        self._last = None
        is_simple = len(puts) == 1 and len(kind) == len(stamp)  # samples, and nothing else
        if is_simple and len(chosen) + self.left_out - left_out == len(stamp):  # none was refused
            self._last = _Shape(
                key,
                samples.names,
                samples.parent[chosen],
                samples.child[chosen],
                chosen,
                puts[0].authority,
                puts[0].static,
                self.left_out - left_out,
            )
        yield from puts

    def _of_copy(self, samples: wire.Samples) -> Iterator[Put]:
        chosen = self._chosen(samples)
        # Stable: a frame's rows stay together, and in order.
        order = np.lexsort(
            (samples.child[chosen], samples.static[chosen], samples.authority[chosen])
        )
        yield from self._puts(samples, chosen[order], each_frame=True)

    def _renamed(self, samples: wire.Samples) -> wire.Samples:
        return samples._replace(names=self._rename(samples.names))

    def _chosen(self, samples: wire.Samples) -> NDArray[np.intp]:
        """The numbers of the samples that this tree accepts; counts all others."""
        self.received += len(samples.child)
        names = samples.names
        is_own = np.fromiter((name.startswith(self._begin) for name in names), bool, len(names))
        may = is_own[samples.child]
        self.left_out += int(np.count_nonzero(~may))
        own = np.flatnonzero(may & samples.has_parent)
        admitted = self._quota.admit(names, samples.parent[own], samples.child[own], counted=is_own)
        if not admitted.all():
            self._count_refused(samples, own[~admitted])
        return own[admitted]

    def _count_refused(self, samples: wire.Samples, refused: NDArray[np.intp]) -> None:
        """Count samples of frames above the quota."""
        self.over_quota += len(refused)
        found = np.unique(samples.authority[refused], return_index=True, return_counts=True)
        for authority, first, count in zip(*(each.tolist() for each in found), strict=True):
            error = self._quota.refusal(samples.names[int(samples.child[refused[first]])])
            self._refuse(f"{self._name}:{samples.authorities[authority]}", count, error)

    def _puts(
        self, samples: wire.Samples, chosen: NDArray[np.intp], *, each_frame: bool
    ) -> Iterator[Put]:
        """Puts of samples that are sorted by authority."""
        rows = samples.rows(chosen)
        authority, static = samples.authority[chosen], samples.static[chosen]
        # Split where static and dynamic rows meet: a link may be the one and then the other.
        meet = np.flatnonzero((np.diff(authority) != 0) | (np.diff(static) != 0)) + 1
        now_ns = time.time_ns()
        for begin, end in pairwise([0, *meet.tolist(), len(rows)] if len(rows) else []):
            name = f"{self._name}:{samples.authorities[int(authority[begin])]}"
            for block in wire.commit_parts(rows[begin:end]):
                for part in self._parts(block, each_frame):
                    put = Put.of_rows(name, bool(static[begin]), part, now_ns)
                    put.is_relayed, put.is_history = True, each_frame
                    yield put

    def _parts(self, rows: TransformRows, each_frame: bool) -> Iterator[TransformRows]:
        """The rows of each put; of some frames if `each_frame`, whose rows stand together."""
        ends = np.array(_frame_bounds(rows)[1:])
        begin = 0
        while begin < len(rows):
            end = min(begin + self._max_rows, len(rows))
            if each_frame:
                last = int(np.searchsorted(ends, begin, "right")) + _MAX_FRAMES - 1
                end = min(end, int(ends[min(last, len(ends) - 1)]))
            yield rows[begin:end]
            begin = end


def _frame_bounds(rows: TransformRows) -> list[int]:
    """The numbers of rows before which another frame begins, and their end."""
    return [0, *(np.flatnonzero(np.diff(rows.child)) + 1).tolist(), len(rows)]
