"""Limits of the time between two samples that a lookup interpolates over."""

from __future__ import annotations

from typing import Any, Final

from zenoh_tf.errors import must_be

#: Any time between two samples. The native tree has the same numbers (core/histories/gap.hpp).
NO_LIMIT: Final = -1
#: No gap: no time that is much longer than the link's samples are usually apart.
NO_GAPS: Final = -2


def max_gap_ns(max_gap_s: Any, otherwise: int = NO_LIMIT, field: str = "max_gap_s") -> int:
    """Return a caller's limit in nanoseconds; None stands for `otherwise`.

    Raises InvalidArgumentException if it is no number, or negative.
    """
    if max_gap_s is None:
        return otherwise
    try:
        seconds = float(max_gap_s)
    except (TypeError, ValueError):
        seconds = -1.0
    if isinstance(max_gap_s, str) or not seconds >= 0:
        raise must_be(field, "0 or more seconds, or None for no limit", max_gap_s)
    return int(min(seconds * 1e9, 9e18))
