"""Lookups at the nearest time that has data, where the time asked for has none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zenoh_tf import StampedTransform
from zenoh_tf.errors import ExtrapolationException, must_be

#: Looks up at a time.
LookUp = Callable[[int], StampedTransform]


def tolerance_ns(nearest_s: Any) -> int:
    """Return a tolerance in nanoseconds. Raises InvalidArgumentException if it is none."""
    if not isinstance(nearest_s, int | float) or not nearest_s >= 0:
        raise must_be("nearest_s", "0 or more seconds, or None", nearest_s)
    return int(min(nearest_s * 1e9, 9e18))


def look_up_nearest(
    look_up: LookUp, stamp_ns: int, error: ExtrapolationException, within_ns: int
) -> StampedTransform:
    """Look up at the time nearest to `stamp_ns` at which every link has data.

    `error` is that of the lookup at `stamp_ns`. It is raised if no such time is within `within_ns`.
    """
    before = _search(look_up, stamp_ns, error, within_ns, _before)
    if before is not None:
        within_ns = stamp_ns - before.stamp_ns
    after = _search(look_up, stamp_ns, error, within_ns, _after)
    if after is not None and (before is None or after.stamp_ns - stamp_ns < within_ns):
        return after
    if before is None:
        raise error
    return before


def _search(
    look_up: LookUp,
    asked_ns: int,
    error: ExtrapolationException,
    within_ns: int,
    step: Callable[[int, int, int], int | None],
) -> StampedTransform | None:
    """Follow the ends of what links have, in one direction, until all have data."""
    at: int | None = asked_ns
    while at is not None and abs(at - asked_ns) <= within_ns:
        if at != asked_ns:
            try:
                return look_up(at)
            except ExtrapolationException as another:
                error = another
        if error.oldest_stamp_ns is None or error.newest_stamp_ns is None:
            return None
        at = step(at, error.oldest_stamp_ns, error.newest_stamp_ns)
    return None


def _before(at: int, oldest: int, newest: int) -> int | None:
    """The last time before `at` at which a link has data; it has none between the two samples
    around a gap, and none outside of its history."""
    return newest if at > newest else oldest if at > oldest else None


def _after(at: int, oldest: int, newest: int) -> int | None:
    """The first time after `at`, as `_before`."""
    return oldest if at < oldest else newest if at < newest else None
