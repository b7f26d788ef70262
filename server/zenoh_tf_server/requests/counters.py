"""How many requests were served, with which outcome, and how long they took.

Each thread counts in a table of its own, so that a request costs neither a lock nor a shared cache
line; a reader sums the tables. A sum may miss what is being counted at that moment.

Thread safety: all methods; a `ThreadCounts` belongs to its thread.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import defaultdict
from time import perf_counter_ns
from typing import Final

OK: Final = "ok"

#: Upper bounds of the histogram's buckets. The last bucket has no bound.
BOUNDS_S: Final = (
    *(50e-6, 100e-6, 250e-6, 500e-6, 1e-3, 2.5e-3, 5e-3, 10e-3, 25e-3, 50e-3),
    *(0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0),
)
_BOUNDS_NS: Final = tuple(round(bound * 1e9) for bound in BOUNDS_S)
_BUCKETS: Final = len(_BOUNDS_NS) + 1


def _empty() -> list[int]:
    return [0] * (_BUCKETS + 1)  # the sum of the durations is last


class ThreadCounts:
    """The counts of one thread."""

    __slots__ = ("begun_ns", "error", "failed", "failures", "ok")

    def __init__(self) -> None:
        #: Of the request that the thread serves: the error's class, None if there is no error.
        self.error: str | None = None
        self.begun_ns = 0
        #: Counts per bucket, and the sum of the durations, by request type.
        self.ok: defaultdict[str, list[int]] = defaultdict(_empty)
        self.failed: defaultdict[str, list[int]] = defaultdict(_empty)
        #: Failed requests by request type and error class.
        self.failures: defaultdict[tuple[str, str], int] = defaultdict(int)

    def end(self, request_type: str) -> None:
        """Count a request of `request_type` that ends now."""
        duration_ns = perf_counter_ns() - self.begun_ns
        if self.error is None:
            counts = self.ok[request_type]
        else:
            counts = self.failed[request_type]
            self.failures[request_type, self.error] += 1
        counts[bisect_left(_BOUNDS_NS, duration_ns)] += 1
        counts[-1] += duration_ns

    def merge(self, other: ThreadCounts) -> None:
        """Add the counts of another thread."""
        for own, others in ((self.ok, other.ok), (self.failed, other.failed)):
            for request_type, counts in list(others.items()):
                own[request_type] = [a + b for a, b in zip(own[request_type], counts, strict=True)]
        for failure, count in list(other.failures.items()):
            self.failures[failure] += count


class _Local(threading.local):
    counts: ThreadCounts | None = None


class RequestCounters:
    """The counts of all threads."""

    def __init__(self) -> None:
        self._local = _Local()
        self._lock = threading.Lock()
        self._running: list[tuple[threading.Thread, ThreadCounts]] = []
        self._ended = ThreadCounts()  # of threads that have ended

    def begin(self, begun_ns: int) -> ThreadCounts:
        """A request has begun on the calling thread, which calls `end` of what this returns."""
        counts = self._local.counts or self._add_thread()
        counts.error = None
        counts.begun_ns = begun_ns
        return counts

    def served(self, request_type: str, begun_ns: int) -> None:
        """Count a request without an error, which the calling thread has served."""
        duration_ns = perf_counter_ns() - begun_ns
        counts = (self._local.counts or self._add_thread()).ok[request_type]
        counts[bisect_left(_BOUNDS_NS, duration_ns)] += 1
        counts[-1] += duration_ns

    def failed(self, error: str) -> None:
        """The request of the calling thread fails with an error of this class."""
        (self._local.counts or self._add_thread()).error = error

    def refused(self, request_type: str, error: str) -> None:
        """Count a request that failed with an error of this class before a worker ran it."""
        (self._local.counts or self._add_thread()).failures[request_type, error] += 1

    def total(self) -> ThreadCounts:
        """The sum over all threads."""
        total = ThreadCounts()
        with self._lock:
            self._fold_ended()
            total.merge(self._ended)
            for _, counts in self._running:
                total.merge(counts)
        return total

    def add_thread(self, request_type: str) -> None:
        """The calling thread will serve requests of this type."""
        self._add_thread().ok[request_type] = _empty()

    def _add_thread(self) -> ThreadCounts:
        counts = self._local.counts = ThreadCounts()
        with self._lock:
            self._fold_ended()
            self._running.append((threading.current_thread(), counts))
        return counts

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
    for bound, count in zip(bounds, counts[:-1], strict=True):
        total += count
        pairs.append((bound, float(total)))
    return pairs, counts[-1] / 1e9
