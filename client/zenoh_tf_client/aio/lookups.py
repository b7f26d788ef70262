"""The lookups of `AsyncTransformClient`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import (
    Estimate,
    EstimateArray,
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
)
from zenoh_tf.clouds.points import Sweep, SweepOptions, deskew
from zenoh_tf.shared_tree import AskServer, SharedTree

from ..requests import estimates, lookups
from ..requests.request import Request
from .session.connection import AsyncConnection

P = ParamSpec("P")
T = TypeVar("T")


class AsyncLookups:
    """A base of `AsyncTransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _connection: AsyncConnection
    #: The server's memory. Lookups there take so little time that every step before them counts.
    _tree: SharedTree

    async def _look_up(
        self,
        look_up: Callable[..., T | AskServer],
        make: Callable[P, Request[T]],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> T:
        found = look_up(*args, **kwargs)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(make(*args, **kwargs), found)

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

    async def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        """As `TransformTree.can_transform`; the server waits, up to 3600 s."""
        found = self._tree.can_transform(target, source, stamp_ns, timeout_s)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(
            lookups.can_transform(target, source, stamp_ns, timeout_s), found
        )

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

    async def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""
        found = self._tree.latest_common_time(a, b)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(lookups.latest_common_time(a, b), found)

    async def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """As `TransformTree.lookup_transforms`, in one request."""
        found = self._tree.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s)
        if not isinstance(found, AskServer):
            return found
        return await self._connection.call(
            lookups.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s), found
        )

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

    async def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: ArrayLike = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
        max_gap_s: float | None = None,
    ) -> Velocity:
        """As `TransformTree.lookup_velocity`."""
        return await self._look_up(
            self._tree.lookup_velocity,
            lookups.lookup_velocity,
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
            max_gap_s=max_gap_s,
        )

    async def estimate_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        max_error_m: float | None = None,
        max_error_rad: float | None = None,
        min_level: float | None = None,
        radius_m: float = 0.0,
    ) -> Estimate:
        """As `TransformTree.estimate_transform`; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``found = await tf.estimate_transform("map", "base", max_error_m=0.02)``
        """
        return await self._look_up(
            self._tree.estimate_transform,
            estimates.estimate_transform,
            target,
            source,
            stamp_ns,
            level=level,
            max_by_s=max_by_s,
            max_error_m=max_error_m,
            max_error_rad=max_error_rad,
            min_level=min_level,
            radius_m=radius_m,
        )

    async def estimate_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        radius_m: float = 0.0,
    ) -> EstimateArray:
        """As `TransformTree.estimate_transforms`, in one request; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``found = await tf.estimate_transforms("map", arms, None)``
        """
        return await self._look_up(
            self._tree.estimate_transforms,
            estimates.estimate_transforms,
            targets,
            sources,
            stamps_ns,
            level=level,
            max_by_s=max_by_s,
            radius_m=radius_m,
        )
