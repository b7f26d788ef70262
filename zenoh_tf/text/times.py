"""Times and lengths of time as people read them; `time_flags.py` reads what people write."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from zenoh_tf._core import age

__all__ = ["CLOCK_RANGE_S", "age", "milliseconds", "reference_ns", "seconds"]

#: A stamp farther than this from the clock counts as of another clock.
CLOCK_RANGE_S: Final = 24 * 3600


def seconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with all nine digits."""
    sign = "-" if stamp_ns < 0 else ""
    whole, rest = divmod(abs(stamp_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"


def milliseconds(stamp_ns: int) -> str:
    """Return a stamp in seconds with three digits, cut off."""
    # As integers first: a double cannot represent nanoseconds since 1970.
    return f"{stamp_ns // 10**6 / 1e3:.3f}"


def reference_ns(stamps_ns: Iterable[int], now_ns: int) -> tuple[int, bool]:
    """Return the time that ages are counted from, and whether that is the clock's, `now_ns`.

    If all links' newest stamps are far from the clock, they are of a simulation or a recording.
    Then the time is the newest of them, so that ages show how far a link lies behind the others.
    """
    newest = [*stamps_ns]
    if not newest or any(abs(now_ns - stamp) <= CLOCK_RANGE_S * 10**9 for stamp in newest):
        return now_ns, True
    return max(newest), False
