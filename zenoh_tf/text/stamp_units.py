"""Stamps that are in seconds, milliseconds or microseconds, where nanoseconds belong.

A stamp near 0 is ordinary in simulated time. So a unit is only named for a stamp that has another
one beside it: those of the tree, or the clock's.
"""

from __future__ import annotations

import time
from typing import Final

from zenoh_tf.text import quoted
from zenoh_tf.text.times import CLOCK_RANGE_S, age

__all__ = ["POWERS", "beside", "ended", "other_unit", "unit_hint", "unit_warning"]

#: Units that a stamp may be in by mistake, as powers of ten nanoseconds.
POWERS: Final = {"seconds": 9, "milliseconds": 6, "microseconds": 3}
#: Stamps after 1973 are of a real clock.
_REAL_NS: Final = 10**17
#: How far a stamp of simulated time may be from the others, if it is read in another unit.
_SIMULATED_MARGIN_NS: Final = 60 * 10**9
#: A forward lookup that misses by less is probably one of the present.
_PRESENT_NS: Final = 2 * 10**9


def other_unit(stamp_ns: int, oldest_ns: int, newest_ns: int) -> str | None:
    """Return the unit of a stamp that should be in nanoseconds; None: it may be in nanoseconds.

    Args:
        stamp_ns: The stamp.
        oldest_ns: The oldest of the stamps beside it, in nanoseconds.
        newest_ns: The newest of them. Read in its unit, the stamp may lie outside of both by a
            day, in simulated time by a minute.
    """
    if stamp_ns <= 0 or stamp_ns * 100 >= oldest_ns:
        return None
    margin_ns = CLOCK_RANGE_S * 10**9 if newest_ns > _REAL_NS else _SIMULATED_MARGIN_NS
    for unit, power in POWERS.items():
        if oldest_ns - margin_ns <= stamp_ns * 10**power <= newest_ns + margin_ns:
            return unit
    return None


def unit_hint(stamp_ns: int, oldest_ns: int, newest_ns: int) -> str | None:
    """Return what is wrong if either a lookup's stamp or its link's stamps are in another unit, and
    the others are of a real clock; else None.

    Args:
        stamp_ns: The time asked for.
        oldest_ns: The oldest stamp of the link.
        newest_ns: Its newest stamp.
    """
    if newest_ns > _REAL_NS:
        now_ns = time.time_ns()  # an old recording is asked for the present, too
        unit = other_unit(stamp_ns, oldest_ns, newest_ns) or other_unit(stamp_ns, now_ns, now_ns)
        return None if unit is None else f"{_looks_like(stamp_ns, unit)}: {_CURE}"
    if stamp_ns > _REAL_NS and newest_ns % 1000:  # as of unit_warning
        unit = other_unit(newest_ns, stamp_ns, stamp_ns)
        if unit is not None:
            return f"the link's newest stamp of {_looks_like(newest_ns, unit)}: {_CURE}"
    return None


def unit_warning(child: str, stamp_ns: int, now_ns: int) -> str | None:
    """Return what is wrong with the stamp of a transform that is about to be written, if it is the
    clock's time of today in another unit; else None.

    Simulated time passes through these stamps, too, but in whole microseconds.
    """
    unit = other_unit(stamp_ns, now_ns, now_ns)
    if unit is None or stamp_ns % 1000 == 0:
        return None
    # Without the number: Python shows each text once.
    return f"the stamp of {quoted(child)} is {_after_1970(stamp_ns, unit)}: {_CURE}"


def beside(stamp_ns: int, oldest_ns: int, newest_ns: int, waited: str, may_wait: bool) -> str:
    """Return what stands behind the error of a lookup at a time that its link has no data for.

    Args:
        stamp_ns: The time asked for.
        oldest_ns: The oldest stamp of the link.
        newest_ns: Its newest stamp.
        waited: How long the lookup has waited; may be empty.
        may_wait: Its method has a ``timeout_s``.
    """
    off_ns = stamp_ns - newest_ns if stamp_ns > newest_ns else oldest_ns - stamp_ns
    off = f"{age(off_ns)} too {'late' if stamp_ns > newest_ns else 'early'}"
    end = f" ({off}, {waited})" if waited else f" ({off})"
    hint = unit_hint(stamp_ns, oldest_ns, newest_ns)
    if hint is None and may_wait and not waited and 0 < stamp_ns - newest_ns <= _PRESENT_NS:
        hint = "pass timeout_s to wait for the next sample"
    return end if hint is None else f"{end}; {hint}"


def ended(newest_ns: int, oldest_ns: int, now_ns: int, failing: str, change: str) -> str:
    """Return when a link has ended that limits a lookup without a time.

    Args:
        newest_ns: The stamp of its newest sample.
        oldest_ns: The oldest stamp of the link that the lookup fails at, which is newer.
        now_ns: The clock's time.
        failing: That link.
        change: What has changed the link that ended; may be empty.
    """
    ago_ns = now_ns - newest_ns
    ago = f"{age(ago_ns)} ago and " if 0 <= ago_ns <= CLOCK_RANGE_S * 10**9 else ""
    hint = unit_hint(newest_ns, oldest_ns, oldest_ns)
    end = "" if hint is None else f"; {hint}"
    before = f"{ago}{age(oldest_ns - newest_ns)} before the oldest sample of {failing}"
    return f", which is {before}{change}{end}"


_CURE: Final = "stamps are integer nanoseconds, such as time.time_ns() or round(seconds * 1e9)"


def _looks_like(stamp_ns: int, unit: str) -> str:
    return f"{stamp_ns} ns is {_after_1970(stamp_ns, unit)}"


def _after_1970(stamp_ns: int, unit: str) -> str:
    return f"{age(stamp_ns)} after 1970, and looks like {unit}"
