"""How many frames of the site's tree one robot may have (``--mirror-of ...,max-frames=``).

Each robot has a share of its own, so that none uses up the frames of another one or of the site. By
default the shares of n robots and of the site are equal: the limit of frames by n + 1.

Thread safety: none; the robot's feed locks.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf import TransformTree
from zenoh_tf.errors import AccessDenied, LimitExceeded, TransformException
from zenoh_tf.text import quoted

from ..limits import Limits

#: Frames that were removed at the site are given back so often, once the share is used up.
_REFRESH_S: Final = 10.0
_PAGE: Final = 1000


def default_share(limits: Limits, robots: int) -> int:
    """The frames of each of several robots that have no number of their own."""
    return max(1, limits.frames // (robots + 1))


class FrameQuota:
    """The names that one robot has in the tree, or in puts that are queued."""

    def __init__(
        self, robot: str, tree: TransformTree, most: int, *, guards_others: bool = False
    ) -> None:
        """`guards_others`: the robot may not have frames that other authorities have written."""
        self._robot = robot
        self._guards_others = guards_others
        self._tree = tree
        self.most = most
        self._names: set[str] = set()
        self._new: set[str] = set()  # since the last refresh: may not be in the tree yet
        self._own: set[str] = set()  # whose links were found to be nobody else's
        self._refresh_s = 0.0
        #: Grows when names may have been forgotten.
        self.generation = 0

    def __len__(self) -> int:
        return len(self._names)

    def admit(
        self,
        names: Sequence[str],
        parent: NDArray[np.uint32],
        child: NDArray[np.uint32],
        counted: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Which rows the robot may store: (n,). Their names count from now on.

        Args:
            names: Of all frames.
            parent: (n,) indexes of the rows' parents.
            child: (n,) indexes of their children.
            counted: (names,) False for names that do not count, as they are no robot's own.
        """
        used = np.unique(np.concatenate([parent, child]))
        used = used[counted[used]]
        is_new = self._find_new(names, used)
        if len(self._names) + int(np.count_nonzero(is_new)) > self.most and self._refresh():
            is_new = self._find_new(names, used)
        known = self._names
        is_checked = self._find_unchecked(names, child)
        rows = np.flatnonzero(is_new[parent] | is_new[child] | is_checked[child])
        may = np.ones(len(child), bool)
        ends = zip(rows.tolist(), parent[rows].tolist(), child[rows].tolist(), strict=True)
        for row, *both in ends:
            wanted = {names[index] for index in both if is_new[index]}
            wanted -= known
            if is_checked[both[1]] and self._owner(names[both[1]]) is not None:
                may[row] = False
            elif len(known) + len(wanted) <= self.most:
                known |= wanted
                self._new |= wanted
                if is_checked[both[1]]:
                    self._own.add(names[both[1]])
            else:
                may[row] = False
        return may

    def _find_new(self, names: Sequence[str], used: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Which names are used and do not count yet: (names,)."""
        is_new = np.zeros(len(names), bool)
        for index in used.tolist():
            is_new[index] = names[index] not in self._names
        return is_new

    def _find_unchecked(self, names: Sequence[str], child: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Which frames may be those of others: (names,)."""
        is_unchecked = np.zeros(len(names), bool)
        if self._guards_others:
            for index in np.unique(child).tolist():
                is_unchecked[index] = names[index] not in self._own
        return is_unchecked

    def refusal(self, name: str) -> TransformException:
        """The error for a frame that the robot may not store."""
        owner = self._owner(name) if self._guards_others else None
        if owner is not None:
            return AccessDenied(
                f"cannot store frame {name!r}: {quoted(owner) if owner else 'another publisher'} "
                f"has written it, and robot {self._robot!r} was found by a pattern; rename one of "
                f"the two, or list the robot (--mirror-of {self._robot}=...)",
                frame=name,
            )
        return LimitExceeded(
            f"cannot store frame {name!r}: robot {self._robot!r} has {self.most:,} frames here, "
            f"which is its limit (--mirror-of {self._robot}=...,max-frames=N)",
            frame=name,
            field="max-frames",
            limit=self.most,
            value=self.most + 1,
        )

    def _owner(self, name: str) -> str | None:
        """Which authority of others has written a frame's link; None if none has."""
        try:
            record = self._tree._frame_record(name)
        except TransformException:  # it is new
            return None
        owner: str = record["authority"]
        is_own = record["parent"] is None or owner.startswith(f"{self._robot}:")
        return None if is_own else owner

    def _refresh(self) -> bool:
        """Forget names that the site has removed meanwhile. Names that came since the last time
        are kept: their rows may still be queued. False: it is too early again."""
        now_s = time.monotonic()
        if now_s < self._refresh_s:
            return False
        self._refresh_s = now_s + _REFRESH_S
        old = list(self._names - self._new)
        kept = set(self._new)
        for begin in range(0, len(old), _PAGE):  # each call holds Python's lock
            page = old[begin : begin + _PAGE]
            kept.update(name for name in page if self._tree.can_transform(name, name))
        self._names, self._new = kept, set()
        self._own &= kept
        self.generation += 1
        return True
