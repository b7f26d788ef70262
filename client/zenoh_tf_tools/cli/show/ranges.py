"""Argument types of the commands that show something: numbers within their range."""

from __future__ import annotations

import argparse


def seconds(text: str) -> float:
    """A number of seconds; an argparse type."""
    return _number(text, 0.0, "seconds")


def hour(text: str) -> float:
    """Seconds up to an hour; an argparse type."""
    value = _number(text, 0.0, "seconds")
    if value > 3600:
        raise argparse.ArgumentTypeError(f"{text!r} is more than 3600 seconds")
    return value


def metres(text: str) -> float:
    """A length; an argparse type."""
    return _number(text, 0.001, "metres")


def frames(text: str) -> int:
    """A number of frames; an argparse type."""
    return _whole(text, 1, 10_000)


def port(text: str) -> int:
    """A port; an argparse type."""
    return _whole(text, 1, 65_535)


def rate(text: str) -> float:
    """A number of times a second; an argparse type."""
    return float(_whole(text, 1, 1_000))


def url(scheme: str, host: str, port: int) -> str:
    """Return an address to open."""
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"


def _number(text: str, least: float, unit: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not least <= value < 1e6:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a number of {unit} of at least {least:g} and below 1e6"
        )
    return value


def _whole(text: str, least: int, most: int) -> int:
    if not text.isdecimal() or not least <= int(text) <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from {least} to {most:,}")
    return int(text)
