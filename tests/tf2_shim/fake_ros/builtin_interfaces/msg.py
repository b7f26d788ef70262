"""builtin_interfaces.msg, as far as transforms need it."""

from dataclasses import dataclass


@dataclass(slots=True)
class Time:
    sec: int = 0
    nanosec: int = 0


@dataclass(slots=True)
class Duration:
    sec: int = 0
    nanosec: int = 0
