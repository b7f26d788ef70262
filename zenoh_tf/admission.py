"""What became of each row of a commit that stores its good rows: stored, dropped, or refused why.

The core decides (core/commits/plan.hpp), for every entrance alike: puts, ROS 2, robots' trees and
recordings. A transaction is rejected as a whole by the first row that would be refused here.

Thread safety: all functions.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from .errors import TransformException

if TYPE_CHECKING:
    from ._core import TransformRows, Tree

#: What became of a row: dropped as too old, stored, or dropped as later than its `max_stamp_ns`.
#: Higher numbers are refusals.
TOO_OLD, STORED, FROM_FUTURE = range(3)
#: Why a row was refused, by its number (`RowResult` of the core).
REASONS: Final = {
    FROM_FUTURE: "from_future",
    3: "not_finite",
    4: "bad_rotation",
    5: "empty_name",
    6: "long_name",
    7: "own_parent",
    8: "bad_stamp",
    9: "other_authority",
    10: "cycle",
    11: "too_deep",
    12: "frame_limit",
    13: "memory_limit",
    14: "stray",
    15: "slashed_name",
    16: "translation_limit",
    17: "bad_name",
}
#: Refused for no fault of the row: the server's policy, or the message that it came in.
QUOTA: Final = "quota"
MESSAGE: Final = "message"
ALL_REASONS: Final = (*REASONS.values(), QUOTA, MESSAGE)

#: Errors that the reason of a refusal has.
_MOST_NAMED: Final = 3


@dataclass(slots=True)
class Refused:
    """A commit of which some rows were refused."""

    stored: bytes  # what became of each row
    by_reason: Counter[str]
    errors: list[TransformException]  # one for each frame and reason, of the first so many

    @property
    def total(self) -> int:
        """How many rows were refused."""
        return self.by_reason.total()

    @property
    def reason(self) -> str:
        """What was wrong with the first of them."""
        return "; ".join(map(described, self.errors[:_MOST_NAMED]))


def described(error: Exception) -> str:
    """Return an error as a reason in the log and in the records of authorities."""
    field = error.field if isinstance(error, TransformException) else None
    return f"{type(error).__name__}: {error}" + (f" (field {field})" if field else "")


def refused(tree: Tree, rows: TransformRows, stored: bytes) -> Refused | None:
    """Return the rows that a commit has refused; None if there are none.

    Args:
        tree: The tree that they were committed to.
        rows: The rows of the commit.
        stored: What became of each, as the tree has returned it.
    """
    if max(stored, default=STORED) <= FROM_FUTURE:
        return None
    counts = Counter(stored)
    by_reason = Counter({REASONS[code]: n for code, n in counts.items() if code > FROM_FUTURE})
    return Refused(stored, by_reason, tree._refusals(rows, stored))
