"""`Buffer`: tf2_ros's buffer, with the server's tree in place of one of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zenoh_tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
)

from . import frames_text
from .connection import connect
from .future import TransformFuture
from .messages import (
    Duration,
    Time,
    TransformStamped,
    message_of,
    nanoseconds,
    stamped_of,
    time_of,
)
from .transforming import do_transform

#: No wait.
_NOW = Duration()

#: What `can_transform` answers with False. Others say nothing about the transform: they are
#: raised.
_NOT_POSSIBLE = (
    LookupException,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
)


class Buffer:
    """Asks the server of the process's connection (`connection.connect`).

    Times and durations are rclpy's or builtin_interfaces'; Time() is the latest common time.
    Lookups return `messages.TransformStamped`, the pose of source in target, and raise tf2's
    exceptions; every method raises ServerUnavailable, a TransformException too, where no
    server answers. A wait ends with the write that makes the answer possible, or at once when
    nothing can; no other thread has to spin. Thread safety: all methods.

    What is set or cleared here is set or cleared in the server, for everyone.

    Args:
        cache_time: Without effect: the server's ``--cache-time`` decides.
        node: Without effect: there is no service to make.
    """

    def __init__(self, cache_time: Any = None, node: Any = None) -> None:
        pass

    # --- lookups

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = _NOW
    ) -> TransformStamped:
        return message_of(
            connect().lookup_transform(target_frame, source_frame, _stamp(time), _seconds(timeout))
        )

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = _NOW,
    ) -> TransformStamped:
        return message_of(
            connect().lookup_transform_full(
                target_frame,
                _stamp(target_time),
                source_frame,
                _stamp(source_time),
                fixed_frame,
                _seconds(timeout),
            )
        )

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = _NOW,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        """Whether a lookup would succeed; with `return_debug_tuple` also why not."""
        answer = _attempt(lambda: self.lookup_transform(target_frame, source_frame, time, timeout))
        return answer if return_debug_tuple else answer[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = _NOW,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]:
        answer = _attempt(
            lambda: self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        )
        return answer if return_debug_tuple else answer[0]

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """The newest time that every link between the two can serve; Time() if all are static."""
        return time_of(connect().latest_common_time(target_frame, source_frame) or 0)

    # --- lookups that wait as futures

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformFuture:
        """The lookup as soon as it succeeds; the future is cancelled, or fails, otherwise."""
        return TransformFuture(
            lambda timeout: self.lookup_transform(target_frame, source_frame, time, timeout)
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformFuture:
        return TransformFuture(
            lambda timeout: self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        )

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformStamped:
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformStamped:
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )

    # --- messages into another frame

    def transform(self, object_stamped: Any, target_frame: str, timeout: Any = _NOW) -> Any:
        """A copy of a stamped message in `target_frame`, at the message's own time.

        A PointStamped, Vector3Stamped, PoseStamped or PoseWithCovarianceStamped, by its
        attributes; TypeException for anything else.
        """
        header = object_stamped.header
        return do_transform(
            object_stamped,
            self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout),
        )

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Any,
        fixed_frame: str,
        timeout: Any = _NOW,
    ) -> Any:
        """The same at another time than the message's, through a frame that is fixed between."""
        header = object_stamped.header
        return do_transform(
            object_stamped,
            self.lookup_transform_full(
                target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
            ),
        )

    # --- writes

    def set_transform(self, transform: Any, authority: str) -> None:
        """Store a TransformStamped in the server, and wait until it is there. Raises
        InvalidArgumentException where tf2 says nothing; one that is too old is dropped."""
        connect().set_transform(stamped_of(transform), authority)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        connect().set_transform(stamped_of(transform), authority, static=True)

    def clear(self) -> None:
        """Forget every sample in the server; static links stay."""
        connect().clear()

    # --- what there is

    def all_frames_as_yaml(self) -> str:
        return frames_text.as_yaml(connect())

    def all_frames_as_string(self) -> str:
        return frames_text.as_string(connect())


def _attempt(lookup: Callable[[], TransformStamped]) -> tuple[bool, str]:
    try:
        lookup()
    except _NOT_POSSIBLE as error:
        return False, str(error)
    return True, ""


def _stamp(time: Any) -> int | None:
    """tf2 writes "latest" as time 0."""
    return nanoseconds(time) or None


def _seconds(timeout: Any) -> float:
    """A negative time-out is none, as in tf2."""
    return max(nanoseconds(timeout), 0) / 1e9
