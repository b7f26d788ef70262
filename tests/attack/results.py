"""What an attack found, with the bound that it must keep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .processes import Call

#: Bounds of a service that holds.
OUTAGE_MS = 100.0
P99_RATIO = 3.0
SMALL_BYTES, SMALL_MS, SMALL_MB = 10_000, 20.0, 20.0
ANY_MS, ANY_MB = 500.0, 200.0


@dataclass(frozen=True)
class Finding:
    """One measured value. With a bound it must not be above that; without one it informs."""

    name: str
    value: float
    unit: str
    bound: float = math.inf
    note: str = ""

    @property
    def kept(self) -> bool:
        return self.value <= self.bound  # false for NaN: what was not measured is not kept


def outage_ms(calls: Sequence[Call], start_s: float, end_s: float, period_s: float) -> float:
    """The longest time in a window without a call that succeeded, less the probe's period."""
    good = sorted(call.end_s for call in calls if call.outcome == "ok")
    inside = [start_s, *(each for each in good if start_s < each < end_s), end_s]
    return max(0.0, 1e3 * (float(np.diff(inside).max()) - period_s))


def in_window(calls: Sequence[Call], start_s: float, end_s: float) -> list[Call]:
    """The calls that were under way in a window."""
    return [call for call in calls if call.end_s > start_s and call.start_s < end_s]


def p99_ms(calls: Sequence[Call], start_s: float, end_s: float) -> float:
    """The 99th percentile of the durations of the calls in a window, whatever came of them."""
    times = [call.end_s - call.start_s for call in in_window(calls, start_s, end_s)]
    return 1e3 * float(np.percentile(times, 99)) if times else math.nan


def failures(calls: Sequence[Call], start_s: float, end_s: float) -> int:
    return sum(call.outcome != "ok" for call in in_window(calls, start_s, end_s))
