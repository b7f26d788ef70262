"""`BufferInterface`: what scripts may ask of any buffer, and the base of a script's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .times import Duration
from .transforming import TransformRegistration, do_transform

#: The default time-out: do not wait.
NO_WAIT = Duration()


class NotImplementedException(Exception):
    """A subclass of `BufferInterface` lacks the method that was called."""


def _lacking(method: str) -> Callable[..., Any]:
    """What stands for a method that a subclass must have."""

    def lacking(self: BufferInterface, *_: Any, **__: Any) -> Any:
        raise NotImplementedException(f"{type(self).__name__} does not implement {method}")

    return lacking


class BufferInterface:
    """The base of `Buffer` and `BufferClient`, and of a script's own buffers.

    A subclass implements `lookup_transform` and `lookup_transform_full`, and `can_transform` and
    `can_transform_full` if the script asks for them; it inherits the transforming of messages.
    Each method that it lacks raises NotImplementedException.
    """

    def __init__(self) -> None:
        #: The table of message types, which all instances share.
        self.registration = TransformRegistration()

    def transform(self, object_stamped: Any, target_frame: str, timeout: Any = NO_WAIT) -> Any:
        """Transform a stamped message to another frame, at the time of the message.

        Args:
            object_stamped: A PointStamped, Vector3Stamped, PoseStamped, PolygonStamped,
                WrenchStamped, PoseWithCovarianceStamped or PointCloud2, recognised by its
                attributes, or a message of a type that `TransformRegistration` knows.
            target_frame: The frame to transform to.
            timeout: How long to wait for writes that make the lookup succeed.

        Returns:
            A transformed copy.

        Raises:
            TransformException: The lookup failed; see the class.
            TypeException: The message is of another kind.
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
        timeout: Any = NO_WAIT,
    ) -> Any:
        """Transform a stamped message to another frame at `target_time`; see `transform`.

        The message is assumed not to move in `fixed_frame` between its time and `target_time`.
        """
        header = object_stamped.header
        return do_transform(
            object_stamped,
            self.lookup_transform_full(
                target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
            ),
        )

    lookup_transform: Any = _lacking("lookup_transform")
    lookup_transform_full: Any = _lacking("lookup_transform_full")
    can_transform: Any = _lacking("can_transform")
    can_transform_full: Any = _lacking("can_transform_full")
