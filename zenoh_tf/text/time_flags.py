"""Times and durations as commands and flags accept them, such as ``--at=-2s``.

The grammar is in docs/reference/commands.md. Each function is a type for argparse, or makes one.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from decimal import Decimal
from typing import Final, NamedTuple

from zenoh_tf.text.flag_values import NUMBER, ambiguous, in_range

#: How to write a time, for help texts.
LIVE_TIMES: Final = "2026-01-31T12:00:00Z, 1700000000.5s, now, now-2s, or -2s for short"
RECORDED_TIMES: Final = (
    "+10s after the recording's first stamp, -2s before its last one, 1700000000.5s, or "
    "2026-01-31T12:00:00Z"
)
#: Longer durations are mistakes: 31 years.
MAX_DURATION_S: Final = 1e9

_UNITS: Final = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86400 * 10**9,
}
_LENGTH: Final = re.compile(rf"(?P<number>{NUMBER})(?P<unit>{'|'.join(_UNITS)})?", re.ASCII)
_ISO: Final = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d)[T ](?P<clock>\d\d:\d\d(:\d\d)?)(\.(?P<fraction>\d{1,9}))?"
    r"(?P<zone>[zZ]|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
#: A stamp as `--json` prints it: in seconds, it would be a billion years or more.
_STAMP: Final = re.compile(r"\d{17,19}", re.ASCII)
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=timezone.utc)
#: What a number without a unit may mean.
_LENGTHS: Final = "{0} seconds or {0} milliseconds; write {0}s or {0}ms"
#: The last time that a stamp can say.
_MAX_NS: Final = (1 << 63) - 1


class RecordedTime(NamedTuple):
    """A time of a recording, as written."""

    text: str
    sign: str  # "+" counts from the first stamp, "-" from the last one, "" is a stamp
    offset_ns: int

    def stamp_ns(self, first_ns: int, last_ns: int) -> int:
        """The time in nanoseconds, in a recording with this first and last stamp."""
        return {"+": first_ns, "-": last_ns, "": 0}[self.sign] + self.offset_ns


def live_time(text: str) -> int:
    """A time of a running tree, in nanoseconds; a sign counts from now."""
    if text == "now":
        return time.time_ns()
    offset = text.removeprefix("now") if text.startswith(("now+", "now-")) else text
    bare = "the stamp {0} s or the stamp {0} ns; write {0}s or {0}ns"
    sign, ns = _time(offset, bare, LIVE_TIMES)
    return _checked(time.time_ns() + ns if sign else ns, text)


def recorded_time(text: str) -> RecordedTime:
    """A time of a recording; a sign counts from its first or its last stamp."""
    bare = "{0} s after the recording's first stamp, or the stamp {0} s; write +{0}s or {0}s"
    sign, ns = _time(text, bare, RECORDED_TIMES)
    return RecordedTime(text, sign, _checked(ns, text))


def duration(
    low_s: float = 0.0, high_s: float = MAX_DURATION_S, *, above: bool = False
) -> Callable[[str], float]:
    """A type for a length of time with its unit, in seconds, from `low_s` or `above` it; 0 needs no
    unit."""

    def parse(text: str) -> float:
        match = _LENGTH.fullmatch(text.removeprefix("-"))
        if match is None:
            raise argparse.ArgumentTypeError(f"{text!r} is not a duration; give 20ms, 2s or 5min")
        if match["unit"] is None and float(match["number"]):
            raise ambiguous(text, _LENGTHS)
        value = float(_length_ns(match) / 10**9) * (-1 if text[0] == "-" else 1)
        return in_range(value, text, "duration", low_s, high_s, above, " s")

    return parse


def _time(text: str, bare: str, forms: str) -> tuple[str, int]:
    """The sign that a time begins with, and its nanoseconds with this sign. For errors: what it may
    mean without a sign and a unit (`bare`), and what a time is (`forms`)."""
    sign = text[0] if text[:1] in ("+", "-") else ""
    match = _LENGTH.fullmatch(text.removeprefix(sign))
    if match is None:
        return sign, _iso_ns(text, forms)
    if match["unit"] is None and not sign and _STAMP.fullmatch(text):
        return sign, int(text)
    if match["unit"] is None:
        raise ambiguous(text, _LENGTHS if sign else bare)
    ns = int(_length_ns(match))
    return sign, -ns if sign == "-" else ns


def _iso_ns(text: str, forms: str) -> int:
    """A time of ISO 8601 in nanoseconds."""
    match = _ISO.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time; give {forms}")
    if match["zone"] is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is ambiguous: it has no time zone; append Z for UTC, or one such as +02:00"
        )
    zone = match["zone"].upper().replace("Z", "+00:00")
    zone = f"{zone[:3]}:{zone[-2:]}"  # Python 3.10 wants the colon
    try:
        moment = datetime.fromisoformat(f"{match['date']}T{match['clock']}{zone}")
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time: {error}") from error
    seconds = (moment - _EPOCH) // timedelta(seconds=1)
    return seconds * 10**9 + int((match["fraction"] or "").ljust(9, "0"))


def _length_ns(match: re.Match[str]) -> Decimal:
    # Decimal, because a double is too coarse for nanoseconds since 1970.
    return Decimal(match["number"]) * _UNITS[match["unit"] or "s"]


def _checked(stamp_ns: int, text: str) -> int:
    if abs(stamp_ns) > _MAX_NS:
        raise argparse.ArgumentTypeError(f"{text!r} is too large for 64 bits of nanoseconds")
    return stamp_ns
