"""Times as people write and read them; the library itself uses integer nanoseconds."""

from __future__ import annotations

import argparse
import re
import time
from decimal import Decimal

from zenoh_tf.times import CLOCK_RANGE_S, age, seconds

__all__ = ["FORMS", "age", "is_clock_time", "parse", "seconds"]

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


def is_clock_time(stamp_ns: int) -> bool:
    """Return whether ``stamp_ns`` is within a day of this machine's clock."""
    return abs(time.time_ns() - stamp_ns) <= CLOCK_RANGE_S * 10**9
