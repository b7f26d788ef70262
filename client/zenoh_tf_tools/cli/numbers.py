"""Numbers in options, as argparse types."""

from __future__ import annotations

import argparse
from typing import Final

#: Longer waits are mistakes.
_MAX_S: Final = 1e6


def positive_seconds(text: str) -> float:
    """A number of seconds above 0."""
    return _number(text, "number of seconds", low=0.0, above=True)


def seconds_or_zero(text: str) -> float:
    """A number of seconds from 0 on."""
    return _number(text, "number of seconds", low=0.0)


def positive_rate(text: str) -> float:
    """A rate in Hz above 0."""
    return _number(text, "rate in Hz", low=0.0, above=True)


def count(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdecimal() or not 0 < int(text) < 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def _number(text: str, what: str, low: float, above: bool = False) -> float:
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not low <= number < _MAX_S or (above and number == low):
        start = "between 0 and" if above else "from 0 to"
        raise argparse.ArgumentTypeError(f"{text!r} is not a {what} {start} {_MAX_S:,.0f}")
    return number
