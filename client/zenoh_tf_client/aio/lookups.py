"""The lookups of `AsyncTransformClient`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import LatestTransform, StampedTransform, TransformArray
from zenoh_tf.points import Sweep, SweepOptions, deskew
from zenoh_tf.shared_tree import AskServer

from ..requests import lookups
from .reads import AsyncReads


class AsyncLookups(AsyncReads):
    """A base of `AsyncTransformClient`."""

    async def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """Look up the pose of `source` in `target` at a time, interpolated.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.
            max_gap_s: The most seconds between two samples of a link to interpolate over; None for
                any.

        Returns:
            ``X_target_source``: it maps coordinates in `source` to coordinates in `target`, in
            metres. Its ``stamp_ns`` is the time that was used; its ``gap_ns`` is not 0 if it was
            interpolated over a gap.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            GapTooLong: The samples of a link around the time are farther apart than `max_gap_s`.
            InvalidArgumentException: A name, stamp, time-out or limit is invalid.
            ServiceException: As for every call; see the class.

        Example:
            ``X_map_base = await tf.lookup_transform("map", "base")``
        """
        found = self._tree.lookup_transform(
            target, source, stamp_ns, timeout_s, max_gap_s=max_gap_s
        )
        if found:
            return found
        request = lookups.lookup_transform(target, source, stamp_ns, timeout_s, max_gap_s=max_gap_s)
        return await self._connection.call(request, found)

    async def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform_full`; the server waits, up to 3600 s."""
        frames = (target, target_stamp_ns, source, source_stamp_ns, fixed_frame)
        found = self._tree.lookup_transform_full(*frames, timeout_s, max_gap_s=max_gap_s)
        if found:
            return found
        request = lookups.lookup_transform_full(*frames, timeout_s, max_gap_s=max_gap_s)
        return await self._connection.call(request, found)

    async def lookup_latest_transform(self, target: str, source: str) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform`."""
        found = self._tree.lookup_latest_transform(target, source)
        if found:
            return found
        return await self._connection.call(lookups.lookup_latest_transform(target, source), found)

    async def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        """Look up the pose of `source` in `target` from the newest samples, in one atomic snapshot.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            ``X_target_source``, the oldest stamp among the samples used (``stamp_ns``) and the
            newest one (``newest_stamp_ns``).

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.

        Example:
            ``X_map_wrist = await tf.lookup_latest_transform_xact("map", "wrist")``
        """
        found = self._tree.lookup_latest_transform_xact(target, source)
        if found:
            return found
        return await self._connection.call(
            lookups.lookup_latest_transform_xact(target, source), found
        )

    async def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`.

        Example:
            ``arm, cup = await tf.lookup_latest_transforms_xact([("map", "arm"), ("map", "cup")])``
        """
        found = self._tree.lookup_latest_transforms_xact(pairs)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(lookups.lookup_latest_transforms_xact(pairs), found)

    async def sample(
        self, target: str, source: str, stamps_ns: ArrayLike, *, max_gap_s: float | None = None
    ) -> TransformArray:
        """As `TransformTree.sample`, in one request.

        Example:
            ``path = await tf.sample("map", "camera", stamps_ns)``
        """
        return await self.lookup_transforms(target, source, stamps_ns, max_gap_s=max_gap_s)

    async def deskew(
        self,
        points: ArrayLike,
        stamps_ns: ArrayLike,
        source: str,
        fixed_frame: str,
        at_ns: int,
        *,
        out: NDArray[Any] | None = None,
        begin_ns: int | None = None,
        max_gap_s: float | None = None,
        missing: Literal["nan", "raw"] = "nan",
        ok: NDArray[np.bool_] | None = None,
        strict: bool = False,
    ) -> NDArray[Any]:
        """As `TransformTree.deskew`.

        The points stay in this process: where the server's memory is not mapped, a query fetches
        the pose at each distinct stamp.

        Raises:
            LimitExceeded: There are more distinct stamps than a message may have rows.

        Example:
            ``cloud = tf.deskew(points, stamps_ns, "lidar", "odom", int(stamps_ns.max()))``
        """
        options = SweepOptions(out, begin_ns, max_gap_s, missing, ok, strict)
        sweep = Sweep(points, stamps_ns, at_ns, options)
        found = deskew(self._tree, sweep, source, fixed_frame)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(lookups.deskew(sweep, source, fixed_frame), found)
