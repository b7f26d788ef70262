"""How many requests were served, with which outcome, and how long they took.

Each thread counts in a table of its own, so that a request costs neither a lock nor a shared cache
line; a reader sums the tables. A sum may miss what is being counted at that moment.

Thread safety: all methods; a `ThreadCounts` belongs to its thread.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Final

OK: Final = "ok"

#: Upper bounds of the histogram's buckets. The last bucket has no bound.
BOUNDS_S: Final = (
    *(50e-6, 100e-6, 250e-6, 500e-6, 1e-3, 2.5e-3, 5e-3, 10e-3, 25e-3, 50e-3),
    *(0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0),
)
_BOUNDS_NS: Final = tuple(round(bound * 1e9) for bound in BOUNDS_S)
_BUCKETS: Final = len(_BOUNDS_NS) + 1
_SUM_NS: Final = _BUCKETS  # the place of the sum, behind the buckets


def _empty() -> list[int]:
    return [0] * (_BUCKETS + 1)


@dataclass(slots=True)
class ThreadCounts:
    """The counts of one thread."""

    #: Of the request that the thread serves: OK, or the name of the error's class.
    outcome: str = OK
    #: Counts per bucket, and the sum of the durations, by family and whether the request failed.
    durations: defaultdict[tuple[str, bool], list[int]] = field(
        default_factory=lambda: defaultdict(_empty)
    )
    #: Failed requests by family and error class.
    failures: defaultdict[tuple[str, str], int] = field(default_factory=lambda: defaultdict(int))

    def add(self, family: str, duration_ns: int) -> None:
        """Count a request of `family` that ended now with `outcome`."""
        failed = self.outcome is not OK
        counts = self.durations[family, failed]
        counts[bisect_left(_BOUNDS_NS, duration_ns)] += 1
        counts[_SUM_NS] += duration_ns
        if failed:
            self.failures[family, self.outcome] += 1

    def merge(self, other: ThreadCounts) -> None:
        """Add the counts of another thread."""
        for key, counts in list(other.durations.items()):
            own = self.durations[key]
            for place, count in enumerate(counts):
                own[place] += count
        for failure, count in list(other.failures.items()):
            self.failures[failure] += count


class RequestCounters:
    """The counts of all threads."""

    def __init__(self) -> None:
        self._local = threading.local()
        self._lock = threading.Lock()
        self._running: list[tuple[threading.Thread, ThreadCounts]] = []
        self._ended = ThreadCounts()  # of threads that have ended

    def of_thread(self) -> ThreadCounts:
        """The calling thread's counts."""
        try:
            counts: ThreadCounts = self._local.counts
        except AttributeError:
            counts = self._local.counts = ThreadCounts()
            with self._lock:
                self._fold_ended()
                self._running.append((threading.current_thread(), counts))
        return counts

    def total(self) -> ThreadCounts:
        """The sum over all threads."""
        total = ThreadCounts()
        with self._lock:
            self._fold_ended()
            total.merge(self._ended)
            for _, counts in self._running:
                total.merge(counts)
        return total

    def _fold_ended(self) -> None:
        """Keep no table for a thread that has ended. Requires the lock."""
        for thread, counts in self._running:
            if not thread.is_alive():
                self._ended.merge(counts)
        self._running = [entry for entry in self._running if entry[0].is_alive()]


def buckets(counts: list[int]) -> tuple[list[tuple[str, float]], float]:
    """The counts as Prometheus wants them: pairs of bound and cumulative count, and the sum in
    seconds."""
    bounds = [*map(repr, BOUNDS_S), "+Inf"]
    pairs = []
    total = 0
    for bound, count in zip(bounds, counts[:_SUM_NS], strict=True):
        total += count
        pairs.append((bound, float(total)))
    return pairs, counts[_SUM_NS] / 1e9
