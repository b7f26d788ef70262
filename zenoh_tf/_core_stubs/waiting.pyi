"""The native module's lookups that wait without a thread: a stub that `_core.pyi` imports, not a
module at run time.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_tf._core import Budget, Tree
from zenoh_tf._core_stubs.transform import Rows

class WakeQueue:
    """Collects the rows of `ParkedLookups` that a commit has woken, for one thread to serve."""

    def take(self) -> list[int] | None:
        """Blocks until rows are woken, and looks them up again. Returns the ids of the
        `ParkedLookups` that are complete now, each once; None after `close`."""
    def close(self) -> None: ...

class ParkedLookups:
    """Lookups that wait without a thread, each row by itself. Made by `park_lookups`."""

    def start(self) -> bool:
        """Looks up every row once. True: all are complete, and no id will come."""
    def cancel(self) -> None: ...
    def links(self) -> int: ...  # how many frames the rows would watch now, at most
    def result(self, waited_s: float, errors: bool = True, budget: Budget | None = None) -> Rows:
        """As `Tree._read_rows`; rows that still wait get what they would get now."""

def park_lookups(
    tree: Tree,
    queue: WakeQueue,
    lookup_id: int,  # what `take` returns once all rows are complete
    names: Sequence[str],
    op: NDArray[np.uint8],
    target: NDArray[np.uint32],
    source: NDArray[np.uint32],
    stamp_ns: NDArray[np.int64],
    fixed: NDArray[np.uint32] | None = None,
    source_stamp_ns: NDArray[np.int64] | None = None,
    max_links: int = ...,  # frames that all waiting lookups may watch; beyond it, a row fails
    max_gap_ns: int = -1,  # of all rows; -1: no limit
) -> ParkedLookups: ...
