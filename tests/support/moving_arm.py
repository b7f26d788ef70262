"""A base that drives a circle and an arm on it, for estimates."""

from __future__ import annotations

import math
from typing import Any

from zenoh_tf import StampedTransform, Transform

MS = 1_000_000
#: The base is published at 20 Hz, and its newest sample is at the end; the arm at 50 Hz.
HISTORY_NS = 9_000 * MS
BASE_NS, ARM_NS = 50 * MS, 20 * MS


def base_at(stamp_ns: int) -> Transform:
    """The base in the map: 1 m/s on a circle of 2 m."""
    angle = 0.5e-9 * (stamp_ns % (1 << 40))
    return Transform.from_rpy(0, 0, angle, (2 * math.sin(angle), -2 * math.cos(angle), 0))


def arm_at(stamp_ns: int) -> Transform:
    """The arm on the base: it swings twice a second."""
    swing = 0.3 * math.sin(4e-9 * math.pi * (stamp_ns % (1 << 40)))
    return Transform.from_rpy(0, swing, 0, (0.2, 0, 0.5))


def tool_at(stamp_ns: int) -> Transform:
    return base_at(stamp_ns) @ arm_at(stamp_ns) @ Transform((0.8, 0, 0))


def fill(tf: Any, end_ns: int) -> None:
    """Store the history: map -> base -> arm -> tool, the last one static; and a lone frame."""
    rows = [
        StampedTransform(parent, child, stamp_ns, pose(stamp_ns))
        for parent, child, period_ns, pose in (
            ("map", "base", BASE_NS, base_at),
            ("base", "arm", ARM_NS, arm_at),
        )
        for stamp_ns in range(end_ns - HISTORY_NS, end_ns + 1, period_ns)
    ]
    tf.set_transforms_xact(rows, "driver")
    tf.set_transform(StampedTransform("arm", "tool", 0, Transform((0.8, 0, 0))), static=True)
    tf.set_transform(StampedTransform("moon", "flag", end_ns, Transform()))
