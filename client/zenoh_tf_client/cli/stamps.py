"""Times as people write and read them; the library itself uses integer nanoseconds."""

from __future__ import annotations

import argparse
import re
import time
from decimal import Decimal

from zenoh_tf.export import CLOCK_RANGE_S

#: How to write a time, for help texts.
FORMS = "nanoseconds; seconds, as 1700000000.5 or 12s; now; now-0.5s, or -0.5s for short"
_STAMP = re.compile(r"(?P<now>now)?(?P<number>[+-]?(\d+\.?\d*|\.\d+))?(?P<unit>s|ns)?")


def parse(text: str) -> int:
    """Return ``text`` as nanoseconds; an argparse type.

    A plain integer is in nanoseconds. A decimal point or the suffix ``s`` makes it seconds.
    An offset after ``now`` is in seconds unless it has the suffix ``ns``. A sign and a suffix
    together are an offset, too: ``-1s`` is ``now-1s``.
    """
    match = _STAMP.fullmatch(text)
    if match is None or not (match["now"] or match["number"]):
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; give {FORMS}")
    digits, unit = match["number"] or "0", match["unit"]
    signed = digits[0] in "+-"
    if match["now"] and match["number"] and not signed:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; give {FORMS}")
    relative = match["now"] is not None or (signed and unit is not None)
    # Decimal, because a double is too coarse for nanoseconds since 1970.
    number = Decimal(digits)
    seconds = unit == "s" or (unit is None and ("." in digits or relative))
    offset_ns = int(number * 10**9) if seconds else int(number)
    return offset_ns + (time.time_ns() if relative else 0)


def seconds(stamp_ns: int) -> str:
    """Return ``stamp_ns`` in seconds with all nine digits."""
    sign = "-" if stamp_ns < 0 else ""
    whole, rest = divmod(abs(stamp_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"


def is_clock_time(stamp_ns: int) -> bool:
    """Return whether ``stamp_ns`` is within a day of this machine's clock."""
    return abs(time.time_ns() - stamp_ns) <= CLOCK_RANGE_S * 10**9


def age(age_ns: int) -> str:
    """Return a length of time in short form: ``850 us``, ``12 ms``, ``3.4 s``, ``5 min``."""
    sign, value = ("-" if age_ns < 0 else ""), abs(age_ns)
    if value < 1_000_000:
        return f"{sign}{value // 1000} us"
    if value < 1_000_000_000:
        return f"{sign}{value / 1e6:.0f} ms"
    if value < 120 * 10**9:
        return f"{sign}{value / 1e9:.1f} s"
    if value < 7200 * 10**9:
        return f"{sign}{value / 60e9:.0f} min"
    return f"{sign}{value / 3600e9:.1f} h"
