"""Numbers, lengths, angles, sizes and names as commands and flags accept them.

`time_flags.py` has times and durations. One grammar, in docs/reference/commands.md. Each function
is a type for argparse, or makes one. argparse puts the flag's name before its errors.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from typing import Final

#: A number without a sign, in regular expressions.
NUMBER: Final = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_DISTANCE: Final = re.compile(rf"(?P<number>{NUMBER})(?P<unit>mm|cm|m)?", re.ASCII)
_METRES: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
#: Of a turn in radians, however it is rounded.
_TURN: Final = 6.3
_ANGLE: Final = re.compile(rf"(?P<number>[+-]?{NUMBER})(?P<unit>deg|rad|mrad)?", re.ASCII)
_RADIANS: Final = {"deg": math.pi / 180, "mrad": 1e-3, "rad": 1.0}


def number(
    low: float = -math.inf, high: float = math.inf, *, above: bool = False
) -> Callable[[str], float]:
    """A type for a number from `low`, or `above` it; the flag's name or its help says the unit."""

    def parse(text: str) -> float:
        if not re.fullmatch(rf"[+-]?{NUMBER}", text, re.ASCII):
            raise argparse.ArgumentTypeError(f"{text!r} is not a number")
        return in_range(float(text), text, "number", low, high, above, "")

    return parse


def length(text: str) -> float:
    """A length with its unit, in metres; not negative. 0 needs no unit."""
    match = _DISTANCE.fullmatch(text.strip())
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a length; give 5mm, 2cm or 0.1m")
    value = float(match["number"])
    if match["unit"] is None and value:
        raise ambiguous(text, "{0} metres or {0} millimetres; write {0}m or {0}mm")
    in_range(value, text, "number", -math.inf, math.inf, False, "")
    return value * _METRES[match["unit"] or "m"]


def angle(*, bare: bool = False, low: float = -math.inf) -> Callable[[str], float]:
    """A type for an angle with its unit, in radians, from `low`; 0 needs no unit. `bare`: a number
    alone is in radians, as other programs write it, up to a whole turn."""

    def parse(text: str) -> float:
        match = _ANGLE.fullmatch(text.strip())
        if match is None:
            raise argparse.ArgumentTypeError(f"{text!r} is not an angle; give 90deg or 1.57rad")
        value = float(match["number"])
        if match["unit"] is None and value and not (bare and abs(value) <= _TURN):
            raise ambiguous(text, "{0} degrees or {0} radians; write {0}deg or {0}rad")
        in_range(value, text, "number", low, math.inf, False, "")
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


def host_and_port(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT or [IPV6]:PORT."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not (port.isascii() and port.isdigit() and int(port) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT, such as 127.0.0.1:9464")
    return host, int(port)


def file_path(text: str) -> str:
    """The path of a file. One in a configuration file is relative to the folder of that."""
    return text


def frames(text: str) -> tuple[str, ...]:
    """Names of frames, as in ``map,world``."""
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of frames, as in map,world")
    return names


def in_range(
    value: float, text: str, what: str, low: float, high: float, above: bool, unit: str
) -> float:
    """`value` if it is within its limits; the error says those that there are."""
    if low <= value <= high and math.isfinite(value) and not (above and value == low):
        return value
    least = f" {'above' if above else 'of at least'} {low:,g}{unit}" if low > -math.inf else ""
    most = f"{' and' if least else ' of'} at most {high:,g}{unit}" if high < math.inf else ""
    raise argparse.ArgumentTypeError(f"{text!r} is not a {what}{least}{most}")


def ambiguous(text: str, readings: str) -> argparse.ArgumentTypeError:
    """The error of a value without a unit; `readings`: what it may mean, with {0} for its text."""
    return argparse.ArgumentTypeError(f"{text!r} is ambiguous: {readings.format(text)}")
