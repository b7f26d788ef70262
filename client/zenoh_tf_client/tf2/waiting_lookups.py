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
        """Start a `lookup_transform` that waits until it succeeds; return its future."""
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
        """Start a `lookup_transform_full` that waits until it succeeds; return its future."""
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
        """Return what `lookup_transform` returns, once it succeeds. Raises what it raises."""
        return await self.wait_for_transform_async(target_frame, source_frame, time)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> TransformStamped:
        """Return what `lookup_transform_full` returns, once it succeeds."""
        return await self.wait_for_transform_full_async(
            target_frame, target_time, source_frame, source_time, fixed_frame
        )
