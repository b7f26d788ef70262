"""The records and columns in the examples of `golden`."""

from __future__ import annotations

import numpy as np

from zenoh_tf import wire
from zenoh_tf._net import handover
from zenoh_tf.wire.samples import NO_PARENT

INSTANCE = "00112233aabbccdd"

NAMES = ["map", "base", "ärm/1"]
_FRAME = {
    **{"name": "base", "parent": "map", "authority": "lidar", "static": False, "samples": 2},
    **{"oldest_stamp_ns": 7, "newest_stamp_ns": 8, "version": 12, "rewritten": 1, "dropped": 0},
    **{"evicted": 0, "reparented": 1, "switched": 0, "authority_changes": 0, "time_jumps": 0},
    "last_change": {
        **{"kind": "reparented", "stamp_ns": 8, "authority": "lidar", "parent_before": "odom"},
        "static_before": False,
    },
}
_RARE_EVENTS = {
    "last_replacement": {
        **{"count": 2, "at_ns": 9, "shift_m": 0.25, "turn_rad": 0.5, "authority_before": "lidar"},
    },
    "last_time_jump": {"at_ns": 8, "newest_stamp_ns": 7},
}
_LATE_LOOKUPS = {"late_failures": 3, "late_waits": 1, "late_ns": 40_000_000}
#: Replies to `info frame`.
FRAME_RECORDS = {
    "reply to info frame": _FRAME,
    "reply to info frame after rare events": _FRAME | _RARE_EVENTS,
    "reply to info frame that was late for lookups": _FRAME | _LATE_LOOKUPS,
}
AUTHORITY = {
    **{"name": "lidar", "frames": 1, "commits": 2, "stored": 3, "dropped": 0, "rewritten": 1},
    **{"conflicts": 0, "refused": 1, "last_refusal": "why", "dropped_by_queue": 0},
    **{"clock_offset_min_s": -0.5, "clock_offset_max_s": 0.25, "stamp_age_s": None},
    "refused_by_reason": {"not_finite": 1},
}
CLIENT = {
    **{"client": "a1b2", "address": None, "clock_offset_min_s": -0.5, "clock_offset_max_s": 0.5},
    "clock_age_s": 1.0,
}
FRAMES = wire.pack(
    {
        "names": NAMES,
        "authorities": ["", "lidar"],
        "frame": np.array([0, 1, 2], np.uint32).tobytes(),
        "version": np.array([4, 8, 12], np.uint64).tobytes(),
        "static": bytes([0, 0, 1]),
        "authority": np.array([0, 1, 1], np.uint32).tobytes(),
        "count": np.array([0, 2, 1], np.uint32).tobytes(),
        "stamp": np.array([7, 8, 0]).tobytes(),
        "parent": np.array([0, NO_PARENT, 1], np.uint32).tobytes(),
        "pose": np.arange(21, dtype=float).tobytes(),
    }
)
ESTIMATES = wire.Estimates(
    ["map", "base", "arm"],
    np.array([0, 0], np.uint32),
    np.array([1, 2], np.uint32),
    np.array([7, 8]),
    0.9,
    500_000_000,
    0.5,
)
ESTIMATE = {
    **{"target_frame": "map", "source_frame": "base", "stamp_ns": 7},
    **{"transform": [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0], "error_m": 0.5, "error_rad": 0.25},
    **{"level": 0.75, "backtests": 200, "basis": "backtest", "by_ns": 3},
    **{"limiting_link": ["map", "base"], "predictor": {"base": "twist"}},
}
ESTIMATE_COLUMNS = (
    np.array([0, 2], np.uint8),
    np.array([7, 8]),
    np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0], [np.nan] * 7]),
    *(np.array([value, np.nan]) for value in (0.5, 0.25, 0.75)),
    *(np.array([value, 0]) for value in (200, 3)),
)
HELLO = {
    **{"tree": "main", "instance": INSTANCE, "server_version": "0.1.0", "clock_ns": 1 << 40},
    "limits": {"message_bytes": 1 << 24, "rows": 100_000},
    "seq": 9,
    "share": handover.Offer("boot", "/run/zenoh-tf/main.sock").fields(),
}
