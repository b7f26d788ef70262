"""The chain that lookups from Python walk, and how these are timed. Needs no package, so that tf2's
interpreter can run it."""

from __future__ import annotations

import itertools
import math
import random
import statistics
import timeit
from collections.abc import Iterator
from typing import Any

FRAMES = ["map", "odom", "base_link", "arm", "camera"]
TARGET, SOURCE = FRAMES[0], FRAMES[-1]
#: The frame of single sets, a child of the target.
SET_FRAME = "set_here"
CACHE_S, SAMPLES = 10, 1000
PERIOD_NS = CACHE_S * 1_000_000_000 // SAMPLES
#: Soon after the epoch: tf2's Python binding passes times as float64 seconds, exact only there.
START_NS = 1_000_000_000_000
END_NS = START_NS + (SAMPLES - 1) * PERIOD_NS
#: Stamps of samples that follow the history.
LATER_NS = itertools.count(END_NS + PERIOD_NS, PERIOD_NS)
#: Lookups of one bulk call.
ROWS = 1000
#: Random times between the first sample and the last, for as many lookups.
TIMES_NS = random.Random(42).sample(range(START_NS, END_NS), ROWS)

#: parent, child, stamp_ns, translation, rotation (x, y, z, w)
Row = tuple[str, str, int, tuple[float, ...], tuple[float, ...]]


def row(parent: str, child: str, stamp_ns: int, link: int, sample: int) -> Row:
    """No rotation is the identity, none is around one axis."""
    half = (0.3 + 0.1 * link + 0.002 * sample) / 2
    x, y, z = ((2, 3, 6)[(link + i) % 3] / 7 * math.sin(half) for i in range(3))
    position = (0.5 + 0.25 * link, -1 + 0.001 * sample, 0.125 * link)
    return parent, child, stamp_ns, position, (x, y, z, math.cos(half))


def history() -> Iterator[Row]:
    """Ten seconds at 100 Hz of a chain of depth 4, and of the frame that is set."""
    links = [*itertools.pairwise(FRAMES), (TARGET, SET_FRAME)]
    for sample in range(SAMPLES):
        for link, (parent, child) in enumerate(links):
            yield row(parent, child, START_NS + sample * PERIOD_NS, link, sample)


def next_row() -> Row:
    return row(TARGET, SET_FRAME, next(LATER_NS), 0, 0)


def us_per_call(statement: str, calls: int, names: dict[str, Any]) -> float:
    """The median of five runs, as other programs run meanwhile."""
    number = max(1, calls // 5)
    return 1e6 * statistics.median(timeit.repeat(statement, number=number, globals=names)) / number
