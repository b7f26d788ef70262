"""`Time` and `Duration`: the fields of builtin_interfaces, and the arguments of rclpy.

Arguments may be any object that `nanoseconds` accepts, such as ROS's own times. Lookups take
numbers as well, in seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

from zenoh_tf.errors import WrongType, must_be

if TYPE_CHECKING:
    from typing_extensions import Self

_NS_PER_S = 1_000_000_000
_MAX_S = 2**63 / _NS_PER_S


@dataclass(init=False, slots=True, order=True)
class _Seconds:
    """Whole seconds, and nanoseconds from 0 to 999,999,999 that are added to them."""

    sec: int
    nanosec: int

    def __init__(
        self, sec: int = 0, nanosec: int = 0, *, seconds: float = 0, nanoseconds: int = 0
    ) -> None:
        """Make one from any of these parts, which are added up.

        Args:
            sec: Whole seconds.
            nanosec: Nanoseconds.
            seconds: Seconds, with a fraction.
            nanoseconds: Nanoseconds.
        """
        if seconds or nanoseconds:  # else the fields are what a message had
            total_ns = int(seconds * _NS_PER_S) + int(nanoseconds) + sec * _NS_PER_S + nanosec
            sec, nanosec = divmod(total_ns, _NS_PER_S)
        self.sec = sec
        self.nanosec = nanosec

    @property
    def nanoseconds(self) -> int:
        """Returns the whole of it in nanoseconds, as rclpy's classes do."""
        return self.sec * _NS_PER_S + self.nanosec

    @classmethod
    def from_msg(cls, msg: Any) -> Self:
        """Return a time or duration of any other class as one of this class."""
        return cls(nanoseconds=nanoseconds(msg))

    def to_msg(self) -> Self:
        """Return a copy, because the class is a message already."""
        return type(self)(self.sec, self.nanosec)


class Duration(_Seconds):
    """A duration, made as in builtin_interfaces or as in rclpy: ``Duration(seconds=0.5)``."""

    __slots__ = ()


class Time(_Seconds):
    """A time, made as in builtin_interfaces or as in rclpy: ``Time(nanoseconds=time.time_ns())``.

    As an argument, Time() means the latest common time.
    """

    __slots__ = ()

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return both fields."""
        return self.sec, self.nanosec

    def __add__(self, duration: Any) -> Time:
        return Time(nanoseconds=self.nanoseconds + nanoseconds(duration))

    def __sub__(self, other: Any) -> Any:
        """Return the duration since another time, or the time before this by a duration."""
        difference_ns = self.nanoseconds - nanoseconds(other)
        # A message has no mark of a time or a duration but the name of its class.
        is_time = type(other).__name__ == "Time"
        return (Duration if is_time else Time)(nanoseconds=difference_ns)


def nanoseconds(time: Any, field: str = "time") -> int:
    """Return a time or duration in nanoseconds.

    Takes the classes of rclpy, builtin_interfaces, ROS 1 and this module, else raises WrongType,
    which names `field`.
    """
    for whole, rest in (("sec", "nanosec"), ("secs", "nsecs")):
        if hasattr(time, rest):
            return int(getattr(time, whole)) * _NS_PER_S + int(getattr(time, rest))
    if hasattr(time, "nanoseconds"):
        return int(time.nanoseconds)
    raise WrongType(f"{field} is neither a time nor a duration: {time!r}", field=field)


def time_of(stamp_ns: int) -> Time:
    """Return a stamp in nanoseconds as a time."""
    return Time(*divmod(stamp_ns, _NS_PER_S))


def stamp_ns(time: Any, field: str = "time") -> int | None:
    """Return a time or a number of seconds in nanoseconds; None for 0, which means the latest.

    Raises WrongType if it is neither, InvalidArgumentException if it is out of range.
    """
    if not _is_number(time):
        return nanoseconds(time, field) or None
    if not abs(time) < _MAX_S:
        raise must_be(field, "seconds as a number, or Time(nanoseconds=...)", time)
    return round(time * _NS_PER_S) or None


def seconds(duration: Any, field: str = "timeout") -> float:
    """Return a duration or a number of seconds in seconds; 0 for a negative one.

    Raises WrongType if it is neither, InvalidArgumentException if it is not a number.
    """
    value = float(duration) if _is_number(duration) else nanoseconds(duration, field) / 1e9
    if math.isnan(value):
        raise must_be(field, "a number of seconds", duration)
    return max(value, 0.0)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
