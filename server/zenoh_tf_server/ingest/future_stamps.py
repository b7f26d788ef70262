"""Stamps from the future: refused or flagged (``--max-future-s``, ``--future``).

The stamps of calls, and of puts that are only flagged, are compared here; those of puts that may be
refused, where their commit is planned (core/commits/plan.cpp).

Static transforms hold at all times, so their stamps are not checked. Simulated time starts near
zero, so it is never ahead of this machine's clock.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf.text import quoted
from zenoh_tf.text.flag_values import number
from zenoh_tf.text.time_flags import MAX_DURATION_S

from ..flag_table import flag


@dataclass(frozen=True, slots=True)
class FutureStamps:
    """How far ahead of this machine's real-time clock a dynamic transform's stamp may be."""

    max_future_s: float = flag(
        "--max-future-s",
        3600.0,
        "how far dynamic stamps may be ahead of this machine's clock; 0: no limit "
        "(default: %(default)g)",
        group="tree",
        type=number(0.0, MAX_DURATION_S),
        metavar="SECONDS",
    )
    policy: Literal["refuse", "flag"] = flag(
        "--future",
        "refuse",
        "with a stamp beyond --max-future-s: refuse it, or store and flag it (default: "
        "%(default)s)",
        group="tree",
        choices=("refuse", "flag"),
        metavar="WHAT",
    )

    @property
    def refuses(self) -> bool:
        """True if transforms beyond the limit are not stored."""
        return self.max_future_s > 0 and self.policy == "refuse"

    @property
    def flags(self) -> bool:
        """True if transforms beyond the limit are stored, counted and reported."""
        return self.max_future_s > 0 and self.policy == "flag"

    @property
    def refused_ahead_ns(self) -> int | None:
        """How far ahead of this machine's clock a stamp may be; None: any is stored."""
        return round(self.max_future_s * 1e9) if self.refuses else None

    def limit_ns(self, now_ns: int | None = None) -> int:
        """The latest stamp within the limit. Requires that there is one."""
        return (time.time_ns() if now_ns is None else now_ns) + round(self.max_future_s * 1e9)

    def beyond(self, commit: wire.Commit, limit_ns: int) -> list[int]:
        """The rows of a commit with a later stamp."""
        if commit.static or commit.rows.newest_stamp <= limit_ns:
            return []
        return [int(row) for row in (commit.rows.stamp > limit_ns).nonzero()[0]]

    def describe(self, commit: wire.Commit, row: int) -> str:
        """What is wrong with a row."""
        stamp_ns = int(commit.rows.stamp[row])
        ahead_s = (stamp_ns - time.time_ns()) * 1e-9
        return (
            f"the stamp of frame {quoted(frame_of(commit, row))}, {stamp_ns} ns, "
            f"lies {ahead_s:,.0f} s ahead of this server's clock: the limit is "
            f"{self.max_future_s:g} s (--max-future-s)"
        )

    def check(self, commit: wire.Commit) -> None:
        """Raise InvalidArgumentException if a row of a call is to be refused."""
        if commit.static or not self.refuses:
            return
        limit_ns = self.limit_ns()
        if commit.rows.newest_stamp > limit_ns:
            rows = self.beyond(commit, limit_ns)
            raise InvalidArgumentException(
                self.describe(commit, rows[0]),
                frame=frame_of(commit, rows[0])[:255],
                field="stamp_ns",
                stamp_ns=int(commit.rows.stamp[rows[0]]),
                limit=limit_ns,
                value=int(commit.rows.stamp[rows[0]]),
            )


def frame_of(commit: wire.Commit, row: int) -> str:
    """The child frame of a row."""
    return commit.rows.names[int(commit.rows.child[row])]
