"""What the stamps and arrivals of a link's samples say: order, jitter, drift and pauses.

Stamps are compared with arrivals, which are of the server's clock, or of the recorder's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zenoh_tf.text.times import CLOCK_RANGE_S

#: The arrival of a sample that was there before the observation.
NO_ARRIVAL: Final = -1
#: Samples that show a period.
_LEAST: Final = 8
#: A pause is longer than this, and than so many periods.
_PAUSE_NS: Final = 250_000_000
PAUSE_PERIODS: Final = 5
_MOST_PAUSES: Final = 64
#: Jitter: the delays differ by this and by so many periods, and the stamps are irregular.
_JITTER_NS: Final = 60_000_000
_JITTER_PERIODS: Final = 2.5
_IRREGULAR: Final = 1.8
#: Drift: seconds a second, and in all; parts of the time, samples of each, and how much of their
#: variance a line explains. A quartz has 0.0001; simulated time may run at 0.99 of real time.
_DRIFT: Final = 0.015
_DRIFT_NS: Final = 20e6
_DRIFT_SPAN_NS: Final = 1_200_000_000
_DRIFT_PARTS: Final = 8
_LEAST_DRIFT_PARTS: Final = 6
_DRIFT_SAMPLES: Final = 5
_DRIFT_FIT: Final = 0.9

Longs = NDArray[np.int64]


class Chunk(NamedTuple):
    """Successive samples of a link that has one parent, in the order of their arrival."""

    arrivals: Longs  # (n,) ns; NO_ARRIVAL at the beginning
    stamps: Longs  # (n,) ns
    poses: NDArray[np.float64]  # (n, 7)
    fresh: int  # the first that no chunk before had


class ArrivalPause(NamedTuple):
    """A time without an arrival, nanoseconds of the clock of the arrivals."""

    start_ns: int
    end_ns: int
    is_gap: bool  # the stamps pause as well; else the samples came late, all at once

    @property
    def length_ns(self) -> int:
        """Between the two arrivals."""
        return self.end_ns - self.start_ns


@dataclass(slots=True)
class Timing:
    """What is known of the times of a link's samples.

    Attributes:
        arrivals: How many samples came.
        last_ns: When the last of them came.
        period_ns: The median time between two stamps.
        least_lead_ns: How far a stamp was ahead of its arrival, at least; negative: behind.
        greatest_lead_ns: The same, at most.
        backwards: Samples that came after newer ones.
        backwards_ns: How much older they were, at most.
        jitter_ns: How far the delays of the stamps differ, if the stamps are irregular.
        drift: By how many seconds a second the stamps gain on the arrivals, if they do steadily.
        strays: Single stamps that were far from those before and after.
        stray_lead_ns: How far the farthest of them was ahead of its arrival.
        pauses: The times without an arrival.
    """

    arrivals: int = 0
    last_ns: int | None = None
    period_ns: float | None = None
    least_lead_ns: int | None = None
    greatest_lead_ns: int | None = None
    backwards: int = 0
    backwards_ns: int = 0
    jitter_ns: float = 0.0
    drift: float = 0.0
    strays: int = 0
    stray_lead_ns: int = 0
    pauses: list[ArrivalPause] = field(default_factory=list)

    def read(self, chunk: Chunk) -> None:
        """Add what a chunk says.

        Args:
            chunk: The samples.
        """
        came = chunk.arrivals != NO_ARRIVAL
        arrivals, stamps = chunk.arrivals[came], chunk.stamps[came]
        fresh = max(0, chunk.fresh - int(np.count_nonzero(~came)))
        if len(arrivals) <= fresh:
            return
        lead = stamps - arrivals
        least, greatest = int(lead[fresh:].min()), int(lead[fresh:].max())
        self.least_lead_ns = min(least, least if self.least_lead_ns is None else self.least_lead_ns)
        self.greatest_lead_ns = max(
            greatest, greatest if self.greatest_lead_ns is None else self.greatest_lead_ns
        )
        before = int(chunk.stamps[~came].max(initial=stamps[0]))
        self._order(stamps, before, fresh)
        distinct = np.unique(stamps)
        if len(distinct) < max(_LEAST, len(stamps) // 2):
            return  # repeated stamps are of no clock
        intervals = np.diff(distinct)
        self.period_ns = float(np.median(intervals))
        self._find_pauses(arrivals, stamps, fresh)
        relative = (lead - lead[0]).astype(np.float64)
        # Without the extremes, which are samples out of order.
        spread = float(np.quantile(relative, 0.85) - np.quantile(relative, 0.15))
        irregular = float(np.quantile(intervals, 0.9)) > _IRREGULAR * self.period_ns
        if irregular and spread > max(_JITTER_NS, _JITTER_PERIODS * self.period_ns):
            self.jitter_ns = max(self.jitter_ns, spread)
        elif abs(int(lead[0])) < CLOCK_RANGE_S * 10**9:
            drift = _drift(arrivals, relative)
            self.drift = max(self.drift, drift, key=abs)

    def _order(self, stamps: Longs, before: int, fresh: int) -> None:
        newest = np.maximum.accumulate(np.concatenate([[before], stamps]))[:-1]
        late = (newest - stamps)[fresh:]
        self.backwards += int(np.count_nonzero(late > 0))
        self.backwards_ns = max(self.backwards_ns, int(late.max()))

    def _find_pauses(self, arrivals: Longs, stamps: Longs, fresh: int) -> None:
        waits = np.diff(arrivals)
        newest = np.maximum.accumulate(stamps)
        for i in np.flatnonzero(waits > max(_PAUSE_NS, PAUSE_PERIODS * (self.period_ns or 0))):
            if i + 1 >= fresh and len(self.pauses) < _MOST_PAUSES:
                is_gap = bool(stamps[i + 1] - newest[i] > waits[i] / 2)
                self.pauses.append(ArrivalPause(int(arrivals[i]), int(arrivals[i + 1]), is_gap))


def _drift(arrivals: Longs, lead_ns: NDArray[np.float64]) -> float:
    """Seconds that the stamps gain a second; 0 unless the least delays of the parts of the time lie
    on a line."""
    span = int(arrivals[-1] - arrivals[0])
    parts = min(_DRIFT_PARTS, len(arrivals) // _DRIFT_SAMPLES)
    if span < _DRIFT_SPAN_NS or parts < _LEAST_DRIFT_PARTS:
        return 0.0
    part = np.minimum((arrivals - arrivals[0]) * parts // span, parts - 1)
    members = [np.flatnonzero(part == n) for n in range(parts)]
    best = [int(each[np.argmax(lead_ns[each])]) for each in members if len(each)]
    at_s, lead_s = (arrivals[best] - arrivals[0]) / 1e9, lead_ns[best] / 1e9
    if len(best) < parts or not lead_s.any():
        return 0.0
    slope = float(np.polyfit(at_s, lead_s, 1)[0])
    fit = float(np.corrcoef(at_s, lead_s)[0, 1]) ** 2 if lead_s.std() > 0 else 0.0
    is_steady = abs(slope) > _DRIFT and abs(slope) * span > _DRIFT_NS and fit > _DRIFT_FIT
    return slope if is_steady else 0.0
