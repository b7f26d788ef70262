"""The native module's change log and its replay: a stub that `_core.pyi` imports, not a module at
run time.
"""

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import _core

class Changes:
    """What commits have changed, as columns, which are checked and never change.

    Frames and parents are indexes into `names`; `wire.samples.NO_PARENT`: it was removed.
    """

    # ProtocolError: the message is malformed; it names the field.
    def __init__(self, message: bytes) -> None: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def authorities(self) -> tuple[str, ...]: ...
    # By change.
    @property
    def kind(self) -> NDArray[np.uint8]: ...
    @property
    def frame(self) -> NDArray[np.uint32]: ...
    @property
    def version(self) -> NDArray[np.uint64]: ...
    # By change that has a sample.
    @property
    def parent(self) -> NDArray[np.uint32]: ...
    @property
    def authority(self) -> NDArray[np.uint32]: ...
    @property
    def stamp(self) -> NDArray[np.int64]: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...  # (n, 7)
    # By orphaned frame: the parent that samples lost.
    @property
    def lost(self) -> NDArray[np.uint32]: ...

class Frames:
    """Some frames with their histories, as columns, which are checked and never change."""

    def __init__(self, message: bytes) -> None: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def authorities(self) -> tuple[str, ...]: ...
    # By frame; `count`: of its samples.
    @property
    def frame(self) -> NDArray[np.uint32]: ...
    @property
    def version(self) -> NDArray[np.uint64]: ...
    @property
    def static(self) -> NDArray[np.uint8]: ...
    @property
    def authority(self) -> NDArray[np.uint32]: ...
    @property
    def count(self) -> NDArray[np.uint32]: ...
    # By sample, of all frames in turn.
    @property
    def stamp(self) -> NDArray[np.int64]: ...
    @property
    def parent(self) -> NDArray[np.uint32]: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...  # (n, 7)

class ChangeLog:
    """Reads a tree's change log and its snapshots, as the messages of them.

    `start`, `stop`, `wait` and `take` belong to one thread; the rest to any.
    """

    def __init__(self, tree: _core.Tree) -> None: ...  # InvalidArgumentException: it has no log
    # From now on, the entries are kept. Returns the number of the commit before the first.
    def start(self) -> int: ...
    def stop(self) -> None: ...
    # Until the next entry is there, the time is up, or wake().
    def wait(self, timeout_s: float) -> None: ...
    def wake(self) -> None: ...
    # (first, last, lost, changes): the entries that are there, about `most_bytes` of them. Empty
    # entries are counted only, and None says that all were. `lost`: the next one is; start again.
    def take(self, most_bytes: int) -> tuple[int, int, bool, bytes | None]: ...
    @property
    def last(self) -> int: ...  # number of the last commit, which may be in progress
    @property
    def nbytes(self) -> int: ...  # of the entries that wait
    # (number, whether frames may have samples of several parents, bounds of the pieces)
    def plan_snapshot(self, piece_bytes: int) -> tuple[int, bool, NDArray[np.uint32]]: ...
    # (last id that was read, frames) of those with ids above one bound, up to the next, or until
    # they have `most_bytes` or more.
    def read_snapshot(self, after: int, last: int, most_bytes: int) -> tuple[int, bytes]: ...

class ChangeReplay:
    """Makes a tree the mirror of another. One thread at a time.

    Of a message that is malformed, ProtocolError names the field; InvalidArgumentException says what
    no tree can have. Nothing has changed then, but names may be new.
    """

    def __init__(self, tree: _core.Tree) -> None: ...
    # Apply the changes at one instant; those that the snapshot has already are left out. `last`:
    # the number after which the other tree was so.
    def apply(self, last: int, changes: bytes) -> None: ...
    def load(self, frames: bytes) -> None: ...
    # Before the first lookup, if the snapshot's plan says so.
    def set_ever_reparented(self) -> None: ...

class InterestReader:
    """Reads what an interested mirror has of a tree. All threads."""

    # Of the frames on the paths between the pairs; without pairs, of all. `newest_only`: only each
    # frame's newest sample. InvalidArgumentException: the tree has no log.
    def __init__(
        self, tree: _core.Tree, pairs: list[tuple[str, str]], newest_only: bool
    ) -> None: ...
    # (number, whether frames may have samples of several parents, what has changed since the last
    # read or None, with `with_all` what a mirror needs that has nothing yet): all commits up to the
    # number are in it. LimitExceeded: there are more than `max_frames` frames.
    def read(
        self, with_all: bool, max_frames: int
    ) -> tuple[int, bool, bytes | None, bytes | None]: ...
    # Whether a read would return a change. Always, without pairs.
    def has_changed(self) -> bool: ...
    @property
    def frames(self) -> int: ...  # as of the last read

# The indices of those that have changed, as soon as there is one; none when the time is up.
def wait_for_changes(
    interests: list[InterestReader], period_s: float, timeout_s: float
) -> list[int]: ...
