"""Times as people write and read them; the library itself only knows integer nanoseconds."""

from __future__ import annotations

import argparse
import re
import time
from decimal import Decimal

from zenoh_tf.export import CLOCK_RANGE_S

_FORMS = "nanoseconds (1700000000500000000), seconds (1700000000.5 or 12s), now, or now-0.5s"
_STAMP = re.compile(r"(?P<now>now)?(?P<number>[+-]?(\d+\.?\d*|\.\d+))?(?P<unit>s|ns)?")


def parse(text: str) -> int:
    """``text`` as nanoseconds, for use as an argparse type.

    Plain integers are nanoseconds; a decimal point or the suffix ``s`` makes it seconds.
    Offsets behind ``now`` are seconds unless they say ``ns``.
    """
    match = _STAMP.fullmatch(text)
    if match is None or not (match["now"] or match["number"]):
        raise argparse.ArgumentTypeError(f"{text!r} is not a time: give {_FORMS}")
    if match["now"] and match["number"] and match["number"][0] not in "+-":
        raise argparse.ArgumentTypeError(f"{text!r} is not a time: give {_FORMS}")
    # Decimal: a double has no room for nanoseconds since 1970.
    number = Decimal(match["number"] or 0)
    seconds = match["unit"] == "s" or (
        match["unit"] is None and ("." in (match["number"] or "") or match["now"] is not None)
    )
    stamp_ns = int(number * 10**9) if seconds else int(number)
    return stamp_ns + (time.time_ns() if match["now"] else 0)


def seconds(stamp_ns: int) -> str:
    """``stamp_ns`` in seconds with all nine digits."""
    sign = "-" if stamp_ns < 0 else ""
    whole, rest = divmod(abs(stamp_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"


def is_clock_time(stamp_ns: int) -> bool:
    """Whether ``stamp_ns`` can be read against this machine's clock."""
    return abs(time.time_ns() - stamp_ns) <= CLOCK_RANGE_S * 10**9


def age(age_ns: int) -> str:
    """A length of time, short: ``850 us``, ``12 ms``, ``3.4 s``, ``5 min``, ``2.0 h``."""
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
