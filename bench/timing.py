"""Clocks: the median cost of a call, and a robot's worth of data to call it on."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable

from zenoh_tf import StampedTransform, Transform

REPEATS = 7
RATE_HZ = 100
HISTORY_S = 10
FRAMES = ["map", "odom", "base_link", "arm", "camera"]
START_NS = 1_700_000_000_000_000_000
END_NS = START_NS + (HISTORY_S * RATE_HZ - 1) * 1_000_000_000 // RATE_HZ


def median_call_s(call: Callable[[], object], seconds: float) -> float:
    """Seconds that one call takes: the median of ``REPEATS`` blocks of calls."""
    calls = 1
    while (spent := _block_s(call, calls)) < seconds / REPEATS / 4:
        calls *= 2
    calls = max(1, round(calls * seconds / REPEATS / spent))
    return statistics.median(_block_s(call, calls) / calls for _ in range(REPEATS))


def median_of_each_s(call: Callable[[], object], seconds: float) -> float:
    """The median over single calls, for calls that are long against the clock."""
    end = time.perf_counter() + seconds
    spent: list[float] = []
    while (start := time.perf_counter()) < end or len(spent) < REPEATS:
        call()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent)


def _block_s(call: Callable[[], object], calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        call()
    return time.perf_counter() - start


def history() -> list[StampedTransform]:
    """Ten seconds of a chain of depth 4 at 100 Hz; no link is the identity."""
    half = 0.5**0.5
    pairs = list(itertools.pairwise(FRAMES))
    return [
        StampedTransform(
            parent,
            child,
            START_NS + i * 1_000_000_000 // RATE_HZ,
            Transform((1.0 + depth, 0.01 * i, -0.5), (0.0, 0.0, half, half)),
        )
        for i in range(HISTORY_S * RATE_HZ)
        for depth, (parent, child) in enumerate(pairs)
    ]
