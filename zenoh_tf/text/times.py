"""Times and lengths of time as people read them; `time_flags.py` reads what people write."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

__all__ = ["CLOCK_RANGE_S", "age", "milliseconds", "reference_ns", "seconds"]

#: A stamp farther than this from the clock counts as of another clock.
CLOCK_RANGE_S: Final = 24 * 3600
_HOUR_NS: Final = 3600 * 10**9


def seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with all nine digits."""
    sign = "-" if stamp_ns < 0 else ""
    whole, rest = divmod(abs(stamp_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"


def milliseconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with three digits, cut off."""
    # As integers first: a double cannot represent nanoseconds since 1970.
    return f"{stamp_ns // 10**6 / 1e3:.3f}"


def age(length_ns: int) -> str:
    """Return a length of time in short form: ``850 us``, ``12 ms``, ``3.4 s``, ``5 min``,
    ``8.0 h``, ``6.5 days``, ``56.9 years``."""
    sign, value = ("-" if length_ns < 0 else ""), abs(length_ns)
    if value < 1_000_000:
        return f"{sign}{value // 1000} us"
    if value < 1_000_000_000:
        return f"{sign}{value / 1e6:.0f} ms"
    if value < 120 * 10**9:
        return f"{sign}{value / 1e9:.1f} s"
    if value < 7200 * 10**9:
        return f"{sign}{value / 60e9:.0f} min"
    if value < 100 * _HOUR_NS:
        return f"{sign}{value / _HOUR_NS:.1f} h"
    days = value / (24 * _HOUR_NS)
    return f"{sign}{days:.1f} days" if days < 2 * 365 else f"{sign}{days / 365.25:.1f} years"


def reference_ns(stamps_ns: Iterable[int], now_ns: int) -> tuple[int, bool]:
    """Return the time that ages are counted from, and whether that is the clock's, `now_ns`.

    If all links' newest stamps are far from the clock, they are of a simulation or a recording.
    Then the time is the newest of them, so that ages show how far a link lies behind the others.
    """
    newest = [*stamps_ns]
    if not newest or any(abs(now_ns - stamp) <= CLOCK_RANGE_S * 10**9 for stamp in newest):
        return now_ns, True
    return max(newest), False
