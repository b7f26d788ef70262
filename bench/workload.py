"""What the Python benchmarks ask; standard library only, for the interpreter that runs tf2."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator

FRAMES = ["map", "odom", "base_link", "arm", "camera"]
TARGET, SOURCE = FRAMES[0], FRAMES[-1]
#: The frame of single sets, a child of the target.
SET_FRAME = "set_here"
CACHE_S = 10
PERIOD_NS = 10_000_000
SAMPLES = CACHE_S * 1_000_000_000 // PERIOD_NS
#: Soon after the epoch: tf2's Python binding passes times as float64 seconds, exact only there.
START_NS = 1_000_000_000_000
END_NS = START_NS + (SAMPLES - 1) * PERIOD_NS
#: Lookups of one bulk call.
ROWS = 1000

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: parent, child, stamp_ns, translation, rotation (x, y, z, w)
Row = tuple[str, str, int, Vector, Quaternion]


def pose(link: int, sample: int) -> tuple[Vector, Quaternion]:
    """No rotation is the identity, none is around one axis."""
    half = (0.3 + 0.1 * link + 0.002 * sample) / 2
    axis = [2 / 7, 3 / 7, 6 / 7]
    x, y, z = (axis[(link + i) % 3] * math.sin(half) for i in range(3))
    return (0.5 + 0.25 * link, -1 + 0.001 * sample, 0.125 * link), (x, y, z, math.cos(half))


def history() -> Iterator[Row]:
    """Ten seconds at 100 Hz of a chain of depth 4, and of the frame that is set."""
    for sample in range(SAMPLES):
        stamp_ns = START_NS + sample * PERIOD_NS
        for link, (parent, child) in enumerate(itertools.pairwise(FRAMES)):
            yield parent, child, stamp_ns, *pose(link, sample)
        yield TARGET, SET_FRAME, stamp_ns, *pose(len(FRAMES), sample)


def later_ns() -> Iterator[int]:
    """Stamps of samples that follow the history."""
    return itertools.count(END_NS + PERIOD_NS, PERIOD_NS)


def times_ns() -> list[int]:
    """``ROWS`` random times in mid-history, between samples."""
    drawn = random.Random(42)
    quarter = (END_NS - START_NS) // 4
    return [drawn.randrange(START_NS + quarter, END_NS - quarter) for _ in range(ROWS)]
