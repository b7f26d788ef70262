"""The methods of `Buffer` that wait for a transform, as futures and as coroutines."""

from __future__ import annotations

from typing import Any

from .future import TransformFuture
from .messages import TransformStamped
from .times import stamp_ns


class WaitingLookups:
    """A base of `Buffer`."""

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformFuture:
        """Start a lookup that waits until it succeeds.

        Args:
            target_frame: The frame to express the pose in.
            source_frame: The frame whose pose is asked for.
            time: The time; Time() for the latest common time.

        Returns:
            A future of what `lookup_transform` returns or raises.
        """
        return TransformFuture(
            lambda client, wait_s: client.lookup_transform(
                target_frame, source_frame, stamp_ns(time), wait_s
            )
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformFuture:
        """Start a lookup between two times that waits until it succeeds.

        Args:
            target_frame: The frame to express the pose in.
            target_time: The time of `target_frame`.
            source_frame: The frame whose pose is asked for.
            source_time: The time of `source_frame`.
            fixed_frame: The frame that is taken not to move between the two times.

        Returns:
            A future of what `lookup_transform_full` returns or raises.
        """
        return TransformFuture(
            lambda client, wait_s: client.lookup_transform_full(
                target_frame,
                stamp_ns(target_time),
                source_frame,
                stamp_ns(source_time),
                fixed_frame,
                wait_s,
            )
        )

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Any
    ) -> TransformStamped:
        """Wait until a lookup succeeds.

        Args:
            target_frame: The frame to express the pose in.
            source_frame: The frame whose pose is asked for.
            time: The time; Time() for the latest common time.

        Returns:
            ``X_target_source``, as `lookup_transform` does.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name or time is invalid.
            ServerUnavailable: No server answers.
        """
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformStamped:
        """Wait until a lookup between two times succeeds.

        Args:
            target_frame: The frame to express the pose in.
            target_time: The time of `target_frame`.
            source_frame: The frame whose pose is asked for.
            source_time: The time of `source_frame`.
            fixed_frame: The frame that is taken not to move between the two times.

        Returns:
            ``X_target_source``, as `lookup_transform_full` does.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name or time is invalid.
            ServerUnavailable: No server answers.
        """
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )
