"""Times, durations and numbers as commands and flags accept them: one grammar, in
docs/reference/commands.md.

Each function is a type for argparse, or makes one. argparse puts the flag's name before its errors.
"""

from __future__ import annotations

import argparse
import math
import re
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Final, NamedTuple

#: How to write a time, for help texts.
LIVE_TIMES: Final = "2026-01-31T12:00:00Z, 1700000000.5s, now, now-2s, or -2s for short"
RECORDED_TIMES: Final = (
    "+10s after the recording's first stamp, -2s before its last one, 1700000000.5s, or "
    "2026-01-31T12:00:00Z"
)
#: Longer durations are mistakes: 31 years.
MAX_DURATION_S: Final = 1e9

_NUMBER: Final = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_UNITS: Final = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86400 * 10**9,
}
_LENGTH: Final = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>{'|'.join(_UNITS)})?", re.ASCII)
_ISO: Final = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d)[T ](?P<clock>\d\d:\d\d(:\d\d)?)(\.(?P<fraction>\d{1,9}))?"
    r"(?P<zone>[zZ]|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
#: What a number without a unit may mean.
_LENGTHS: Final = "{0} seconds or {0} milliseconds; write {0}s or {0}ms"
_DISTANCE: Final = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>mm|cm|m)?", re.ASCII)
_METRES: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_ANGLE: Final = re.compile(rf"(?P<number>[+-]?{_NUMBER})(?P<unit>deg|rad|mrad)?", re.ASCII)
_RADIANS: Final = {"deg": math.pi / 180, "mrad": 1e-3, "rad": 1.0}
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
            raise _ambiguous(text, _LENGTHS)
        value = float(_length_ns(match) / 10**9) * (-1 if text[0] == "-" else 1)
        return _in_range(value, text, "duration", low_s, high_s, above, " s")

    return parse


def number(
    low: float = -math.inf, high: float = math.inf, *, above: bool = False
) -> Callable[[str], float]:
    """A type for a number from `low`, or `above` it; the flag's name or its help says the unit."""

    def parse(text: str) -> float:
        if not re.fullmatch(rf"[+-]?{_NUMBER}", text, re.ASCII):
            raise argparse.ArgumentTypeError(f"{text!r} is not a number")
        return _in_range(float(text), text, "number", low, high, above, "")

    return parse


def length(text: str) -> float:
    """A length with its unit, in metres; not negative. 0 needs no unit."""
    match = _DISTANCE.fullmatch(text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a length; give 5mm, 2cm or 0.1m")
    value = float(match["number"])
    if match["unit"] is None and value:
        raise _ambiguous(text, "{0} metres or {0} millimetres; write {0}m or {0}mm")
    _in_range(value, text, "number", -math.inf, math.inf, False, "")
    return value * _METRES[match["unit"] or "m"]


def angle(*, bare: bool = False, low: float = -math.inf) -> Callable[[str], float]:
    """A type for an angle with its unit, in radians, from `low`; 0 needs no unit. `bare`: a number
    alone is in radians, as other programs write it."""

    def parse(text: str) -> float:
        match = _ANGLE.fullmatch(text.strip())
        if match is None:
            raise argparse.ArgumentTypeError(f"{text!r} is not an angle; give 90deg or 1.57rad")
        value = float(match["number"])
        if match["unit"] is None and value and not bare:
            raise _ambiguous(text, "{0} degrees or {0} radians; write {0}deg or {0}rad")
        _in_range(value, text, "number", low, math.inf, False, "")
        return value * _RADIANS[match["unit"] or "rad"]

    return parse


def whole(low: int, high: int = 10**9) -> Callable[[str], int]:
    """A type for a whole number of this range."""

    def parse(text: str) -> int:
        if not re.fullmatch(r"\d{1,20}", text, re.ASCII) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a whole number from {low} to {high:,}"
            )
        return int(text)

    return parse


def size(low: int = 1) -> Callable[[str], int]:
    """A type for a number of bytes of at least `low`, such as 512MB or 4G; a K is 1024 bytes."""

    def parse(text: str) -> int:
        match = re.fullmatch(r"(\d{1,20})([KMG]?)B?", text.upper(), re.ASCII)
        value = int(match[1]) << {"": 0, "K": 10, "M": 20, "G": 30}[match[2]] if match else 0
        if not low <= value < 1 << 62:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a number of bytes of at least {low:,}, such as 512MB or 4G"
            )
        return value

    return parse


def frames(text: str) -> tuple[str, ...]:
    """Names of frames, as in ``map,world``."""
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of frames, as in map,world")
    return names


def _time(text: str, bare: str, forms: str) -> tuple[str, int]:
    """The sign that a time begins with, and its nanoseconds with this sign. For errors: what it may
    mean without a sign and a unit (`bare`), and what a time is (`forms`)."""
    sign = text[0] if text[:1] in ("+", "-") else ""
    match = _LENGTH.fullmatch(text.removeprefix(sign))
    if match is None:
        return sign, _iso_ns(text, forms)
    if match["unit"] is None:
        raise _ambiguous(text, _LENGTHS if sign else bare)
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
    try:
        moment = datetime.fromisoformat(f"{match['date']}T{match['clock']}{match['zone'].upper()}")
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time: {error}") from error
    seconds = (moment - _EPOCH) // timedelta(seconds=1)
    return seconds * 10**9 + int((match["fraction"] or "").ljust(9, "0"))


def _length_ns(match: re.Match[str]) -> Decimal:
    # Decimal, because a double is too coarse for nanoseconds since 1970.
    return Decimal(match["number"]) * _UNITS[match["unit"] or "s"]


def _in_range(
    value: float, text: str, what: str, low: float, high: float, above: bool, unit: str
) -> float:
    """`value` if it is within its limits; the error says those that there are."""
    if low <= value <= high and math.isfinite(value) and not (above and value == low):
        return value
    least = f" {'above' if above else 'of at least'} {low:,g}{unit}" if low > -math.inf else ""
    most = f"{' and' if least else ' of'} at most {high:,g}{unit}" if high < math.inf else ""
    raise argparse.ArgumentTypeError(f"{text!r} is not a {what}{least}{most}")


def _checked(stamp_ns: int, text: str) -> int:
    if abs(stamp_ns) > _MAX_NS:
        raise argparse.ArgumentTypeError(f"{text!r} is too large for 64 bits of nanoseconds")
    return stamp_ns


def _ambiguous(text: str, readings: str) -> argparse.ArgumentTypeError:
    return argparse.ArgumentTypeError(f"{text!r} is ambiguous: {readings.format(text)}")
