"""The estimates of `AsyncTransformClient`: poses with their errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from zenoh_tf import Estimate, EstimateArray
from zenoh_tf.shared_tree import AskServer, SharedTree

from ..requests import estimates
from .session.shared_reads import SharedReads


class AsyncEstimates:
    """A base of `AsyncTransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _reads: SharedReads
    _tree: SharedTree

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
        """Estimate the pose of `source` in `target` at a time, now for example, and its error.

        Links are carried on beyond their newest samples. How wrong that may be is measured: the
        same question is answered for past instants, as far from their data, and compared with
        what came then. docs/how-to/estimate.md says what the bound promises, and what it does not.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for now, by the server's clock.
            level: The share of answers whose error is within the bounds, above 0 and below 1.
            max_by_s: How far a link may be carried beyond its newest sample, in seconds.
            max_error_m: The largest error of the position to accept, in metres; None: any.
            max_error_rad: The largest error of the rotation to accept, in radians; None: any.
            min_level: The level to insist on with a limit, if the history is too short for `level`,
                above 0 and below 1; None: `level` itself.
            radius_m: The radius of the body around the origin of `source` whose points
                `error_m` is to hold for, in metres.

        Returns:
            ``X_target_source`` in metres, and the bounds of its errors in metres and radians.

        Raises:
            TooUncertain: An error may be larger than its limit.
            ForwardExtrapolationException: A link ends more than `max_by_s` before the time.
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: An argument is invalid; `field` names it.
            ServiceException: As for every call; see the class.

        Example:
            ``X = (await tf.estimate_transform("map", "base", max_error_m=0.02)).transform``
        """
        terms: dict[str, Any] = {
            **{"level": level, "max_by_s": max_by_s, "radius_m": radius_m},
            **{"max_error_m": max_error_m, "max_error_rad": max_error_rad, "min_level": min_level},
        }
        found = self._tree.estimate_transform(target, source, stamp_ns, **terms)
        if type(found) is not AskServer:
            return found
        return await self._reads.ask(
            found, estimates.estimate_transform(target, source, stamp_ns, **terms)
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
        """Estimate many poses and their errors in one request, each in a transaction of its own.

        Args:
            targets: (n,) frames to express the poses in, or one frame for all rows.
            sources: (n,) frames whose poses are asked for, or one frame for all rows.
            stamps_ns: (n,) times in nanoseconds, or one for all rows; None for now, by the
                server's clock.
            level: As of `estimate_transform`, also the others.
            max_by_s: Seconds.
            radius_m: Metres.

        Returns:
            (n,) rows. A row that failed has its error's code in ``status``, and NaN.

        Raises:
            InvalidArgumentException: The lengths differ, or an argument is invalid.
            ServiceException: As for every call; see the class.

        Example:
            ``near = (await tf.estimate_transforms("map", arms, None)).error_m < 0.02``
        """
        found = self._tree.estimate_transforms(
            targets, sources, stamps_ns, level=level, max_by_s=max_by_s, radius_m=radius_m
        )
        if type(found) is not AskServer:
            return found
        request = estimates.estimate_transforms(
            targets, sources, stamps_ns, level=level, max_by_s=max_by_s, radius_m=radius_m
        )
        return await self._reads.ask(found, request)
