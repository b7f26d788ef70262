"""The embedded tree, called from Python: depth 4, ten seconds of history at 100 Hz."""

from __future__ import annotations

import itertools

import numpy as np

from bench.timing import END_NS, FRAMES, START_NS, history, median_call_s
from zenoh_tf import StampedTransform, Transform, TransformTree

ROWS = 1000


def measure(seconds: float) -> dict[str, float]:
    """Nanoseconds a call, or a lookup where a call makes many."""
    tree = TransformTree(cache_time_s=1e6)
    for stamped in history():
        tree.set_transform(stamped)
    target, source = FRAMES[0], FRAMES[-1]
    middle_ns = (START_NS + END_NS) // 2 + 1_234_567
    stamps_ns = np.linspace(START_NS, END_NS, ROWS).astype(np.int64)
    stamp = itertools.count(END_NS + 1)
    pose = Transform((1.0, 2.0, 3.0))

    def set_one() -> None:
        tree.set_transform(StampedTransform("map", "set_here", next(stamp), pose))

    calls = {
        "lookup_common_ns": lambda: tree.lookup_transform(target, source),
        "lookup_at_ns": lambda: tree.lookup_transform(target, source, middle_ns),
        "lookup_latest_ns": lambda: tree.lookup_latest_transform(target, source),
        "lookup_latest_xact_ns": lambda: tree.lookup_latest_transform_xact(target, source),
        "set_ns": set_one,
    }
    figures = {name: 1e9 * median_call_s(call, seconds) for name, call in calls.items()}
    bulk_s = median_call_s(lambda: tree.lookup_transforms(target, source, stamps_ns), seconds)
    figures["lookup_transforms_ns_per_lookup"] = 1e9 * bulk_s / ROWS
    return {name: round(value, 1) for name, value in figures.items()}
