"""Histories written by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .history import COMMITTED, History

Versions = dict[int, int]  # stamps by link


class Written(NamedTuple):
    invoked_ns: int
    responded_ns: int
    reads: Versions
    writes: Versions
    outcome: int
    thread: int | None


def transaction(
    when: tuple[int, int],
    reads: Versions | None = None,
    writes: Versions | None = None,
    outcome: int = COMMITTED,
    thread: int | None = None,
) -> Written:
    return Written(*when, reads or {}, writes or {}, outcome, thread)


def history(*transactions: Written, in_order: bool = True) -> History:
    """Return a history. A transaction without a thread has one of its own, by its number."""
    rows, accesses = [], []
    for number, (invoked, responded, reads, writes, outcome, thread) in enumerate(transactions):
        rows.append((number if thread is None else thread, invoked, responded, outcome))
        accesses += [(number, 0, link, stamp) for link, stamp in reads.items()]
        accesses += [(number, 1, link, stamp) for link, stamp in writes.items()]
    return History(
        np.array(rows, dtype=np.int64).reshape(-1, 4),
        np.array(accesses, dtype=np.int64).reshape(-1, 4),
        in_order,
    )
