"""Where frames have been: lines of past positions in the fixed frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zenoh_tf_tools.viewer.source import Lookups, ViewedLink

#: Most frames with a trail, and most points of one.
MAX_TRAILS = 16
_POINTS = 400
#: No two points of a trail are closer together in time.
_STEP_NS = 20_000_000
#: The last points of a trail may be missing for so long, as samples come late.
_GAP_NS = 1_000_000_000


@dataclass(frozen=True)
class Trails:
    """Trails in the fixed frame.

    Attributes:
        segments: (n, 2, 3) the two ends of each segment, metres.
        newness: (n, 2) how new these ends are, from 0 at the beginning of a trail to 1.
        ends: (3,) the last point of each trail that goes as far as its frame, metres.
    """

    segments: NDArray[np.float64]
    newness: NDArray[np.float64]
    ends: Mapping[str, NDArray[np.float64]]


NO_TRAILS = Trails(np.empty((0, 2, 3)), np.empty((0, 2)), {})


def trails_of(
    lookups: Lookups, fixed: str, links: Iterable[ViewedLink], until_ns: int, length_s: float
) -> Trails:
    """Return the trails of the first frames whose links move.

    A trail has a gap where a lookup has no answer, and ends with the latest one that has.

    Args:
        lookups: The tree.
        fixed: The frame that stands still.
        links: Frames to draw trails of; static ones are left out.
        until_ns: The time at which the trails end, in nanoseconds.
        length_s: How long before it they begin, in seconds.
    """
    # Multiples of the step, so that a trail does not shimmer as time passes.
    step_ns = max(_STEP_NS, int(length_s * 1e9 / _POINTS))
    last = until_ns // step_ns
    stamps_ns = np.arange(last - int(length_s * 1e9 / step_ns), last + 1) * step_ns
    stamps_ns = stamps_ns[stamps_ns >= 0]
    moving = [x.name for x in links if x.age_s is not None and x.name != fixed][:MAX_TRAILS]
    newness = np.linspace(0.0, 1.0, len(stamps_ns))
    found = [(NO_TRAILS.segments, NO_TRAILS.newness)]
    ends = {}
    for name in moving:
        points = lookups.lookup_transforms(fixed, name, stamps_ns).translations
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        whole = ~np.isnan(pairs).any(axis=(1, 2))
        found.append((pairs[whole], np.stack([newness[:-1], newness[1:]], axis=1)[whole]))
        known = np.flatnonzero(~np.isnan(points[:, 0]))
        if len(known) and stamps_ns[known[-1]] >= until_ns - _GAP_NS:
            ends[name] = points[known[-1]]
    segments, newnesses = zip(*found, strict=True)
    return Trails(np.concatenate(segments), np.concatenate(newnesses), ends)
