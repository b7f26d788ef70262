"""The samples in a message of the stream, and in a piece of a snapshot, as columns."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Changes, Frames, TransformRows

#: Kinds of changes, as in records/change_log.hpp. The first two have a sample.
SAMPLE, STATIC, CREATED, CLEARED, REMOVED, NEW_VERSION, ORPHANED = range(7)

#: The parent of a sample whose parent was removed, and of an orphaned frame that lost none.
NO_PARENT: Final = (1 << 32) - 1


class Samples(NamedTuple):
    """The samples of changes or frames as columns, a row for each."""

    names: list[str]
    authorities: list[str]
    parent: NDArray[np.uint32]  # (n,) indexes into names, or NO_PARENT
    child: NDArray[np.uint32]  # (n,)
    stamp: NDArray[np.int64]  # (n,) ns
    pose: NDArray[np.float64]  # (n, 7)
    authority: NDArray[np.uint32]  # (n,) indexes into authorities
    static: NDArray[np.bool_]  # (n,)

    @property
    def has_parent(self) -> NDArray[np.bool_]:
        """(n,) False if the parent was removed."""
        return np.not_equal(self.parent, NO_PARENT)

    def rows(self, chosen: NDArray[np.intp]) -> TransformRows:
        """Some of them, each with a parent, by their numbers."""
        parent, child = self.parent[chosen], self.child[chosen]
        return TransformRows(self.names, parent, child, self.stamp[chosen], self.pose[chosen])


def samples_of_changes(changes: Changes) -> Samples:
    has_sample = changes.kind <= STATIC
    return Samples(
        list(changes.names),
        list(changes.authorities),
        changes.parent,
        changes.frame[has_sample],
        changes.stamp,
        changes.pose,
        changes.authority,
        changes.kind[has_sample] == STATIC,
    )


def samples_of_frames(frames: Frames) -> Samples:
    return Samples(
        list(frames.names),
        list(frames.authorities),
        frames.parent,
        np.repeat(frames.frame, frames.count),
        frames.stamp,
        frames.pose,
        np.repeat(frames.authority, frames.count),
        np.repeat(frames.static != 0, frames.count),
    )
