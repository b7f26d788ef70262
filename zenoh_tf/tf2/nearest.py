"""Lookups at the nearest time that has data, where the time asked for has none."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_tf import StampedTransform
from zenoh_tf.errors import ExtrapolationException


def look_up_nearest(
    look_up: Callable[[int], StampedTransform],
    stamp_ns: int,
    error: ExtrapolationException,
    within_ns: int,
) -> StampedTransform:
    """Look up at the time nearest to `stamp_ns` at which every link has data.

    `error` is that of the lookup at `stamp_ns`. It is raised if no such time is within `within_ns`.
    """
    found = []
    for later in (False, True):
        at, failure = stamp_ns, error
        while True:
            # A link has none outside of its history, and between the two samples around a gap.
            ends = (failure.oldest_stamp_ns, failure.newest_stamp_ns)
            distances = [abs(end - at) for end in ends if end is not None and later == (end > at)]
            at += min(filter(None, distances), default=2**63) * (1 if later else -1)
            if abs(at - stamp_ns) > within_ns:
                break
            try:
                found.append(look_up(at))
                break
            except ExtrapolationException as another:
                failure = another
    if not found:
        raise error
    return min(found, key=lambda each: abs(each.stamp_ns - stamp_ns))
