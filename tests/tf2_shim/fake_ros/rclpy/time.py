"""rclpy.time"""

from __future__ import annotations

from builtin_interfaces.msg import Time as TimeMessage  # type: ignore[import-not-found]

from .duration import Duration


class Time(Duration):
    def __sub__(self, duration: Duration) -> Time:
        return Time(nanoseconds=self._nanoseconds - duration.nanoseconds)

    def to_msg(self) -> TimeMessage:
        return TimeMessage(*divmod(self._nanoseconds, 10**9))

    @classmethod
    def from_msg(cls, message: TimeMessage) -> Time:
        return cls(nanoseconds=message.sec * 10**9 + message.nanosec)
