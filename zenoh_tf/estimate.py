"""Poses with bounds of their errors, and the refusal of those that are too uncertain."""

from __future__ import annotations

import functools
import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

from zenoh_tf import _core, array
from zenoh_tf._core import Estimate, Transform
from zenoh_tf.errors import TooUncertain, must_be

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from zenoh_tf._core_stubs.estimates import EstimateColumns

    Names = str | Sequence[str] | None

#: What reads return that have no answer.
NoAnswer_co = TypeVar("NoAnswer_co", covariant=True)

#: What `TransformTree.set_motion_limits` takes, in the order of the native tree.
MOTION_LIMITS: Final = (
    "max_speed_m_s",
    "max_accel_m_s2",
    "max_rate_rad_s",
    "max_rate_accel_rad_s2",
    "max_clock_error_s",
)


def estimate_of(record: Mapping[str, Any]) -> Estimate:
    """Return the estimate of a map of its fields.

    Args:
        record: Values by field name, from a server; the transform is x, y, z in metres, qx, qy,
            qz, qw.
    """
    values = {name: record[name] for name in Estimate.__match_args__}
    values["transform"] = Transform.from_pose(values["transform"])
    if (link := values["limiting_link"]) is not None:
        parent, child = link
        values["limiting_link"] = parent, child
    return Estimate(**values)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class EstimateArray:
    """Estimates as columns, one per row. A row that failed has the code of its error in `status`,
    and NaN.

    Attributes:
        status: (n,) uint8, 0 or the code of an error (`zenoh_tf.errors.BY_CODE`).
        stamps_ns: (n,) int64, the time of each pose in nanoseconds.
        poses: (n, 7) float64 rows x, y, z (metres), qx, qy, qz, qw.
        error_m: (n,) float64, bounds of the positions' errors in metres.
        error_rad: (n,) float64, bounds of the orientations' errors in radians.
        level: (n,) float64, the share of answers within both bounds.
        backtests: (n,) int64, the number of past instants that the bounds rest on.
        by_ns: (n,) int64, how far the worst link is carried beyond its newest sample, nanoseconds.
        targets: The targets' names: one for all rows, or (n,); None if unknown.
        sources: The sources' names, in the same form.
    """

    status: NDArray[np.uint8]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    error_m: NDArray[np.float64]
    error_rad: NDArray[np.float64]
    level: NDArray[np.float64]
    backtests: NDArray[np.int64]
    by_ns: NDArray[np.int64]
    targets: Names = None
    sources: Names = None

    @property
    def ok(self) -> NDArray[np.bool_]:
        """(n,) True for the rows that have an estimate."""
        ok: NDArray[np.bool_] = self.status == 0
        return ok

    @classmethod
    def of_columns(
        cls, columns: Sequence[NDArray[Any]], targets: Names, sources: Names
    ) -> EstimateArray:
        """Return the instance of the arrays that `columns` returns.

        Args:
            columns: The arrays, in the order of the fields.
            targets: The targets' names: one for all rows, or (n,).
            sources: The sources' names, in the same form.
        """
        status, stamps_ns, poses, error_m, error_rad, level, backtests, by_ns = columns
        return cls(
            status, stamps_ns, poses, error_m, error_rad, level, backtests, by_ns, targets, sources
        )

    def columns(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays, in the order of the fields."""
        return (
            *(self.status, self.stamps_ns, self.poses, self.error_m, self.error_rad),
            *(self.level, self.backtests, self.by_ns),
        )

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"EstimateArray({array.summary(self.status, self.targets, self.sources)})"


@functools.lru_cache(64)  # it takes half of the time
def max_by_ns(max_by_s: float) -> int:
    """Return how far links may be carried on, in nanoseconds.

    Args:
        max_by_s: Seconds, from 0 to 1e9.

    Raises:
        InvalidArgumentException: The number is out of that range.
    """
    if not 0 <= max_by_s <= 1e9:
        raise must_be("max_by_s", "from 0 to 1e9 seconds", max_by_s)
    return round(max_by_s * 1e9)


def check(
    estimate: Estimate,
    max_error_m: float | None,
    max_error_rad: float | None,
    min_level: float | None,
) -> Estimate:
    """Return the estimate if its errors are within the limits.

    Args:
        estimate: The estimate.
        max_error_m: Largest error of the position in metres; None for any.
        max_error_rad: Largest error of the orientation in radians; None for any.
        min_level: The level that it must have if there is a limit; None for any.

    Raises:
        TooUncertain: An error may be larger than its limit, or the level is too low.
        InvalidArgumentException: A limit is negative, or the level not between 0 and 1.
    """
    limits = {
        "max_error_m": (max_error_m, estimate.error_m, "m"),
        "max_error_rad": (max_error_rad, estimate.error_rad, "rad"),
    }
    for field, (limit, _, _) in limits.items():
        if limit is not None and not limit >= 0:
            raise must_be(field, "0 or more", limit)
    if min_level is not None and not 0 < min_level < 1:
        raise must_be("min_level", "above 0 and below 1", min_level)
    for field, (limit, error, unit) in limits.items():
        if limit is not None and not error <= limit:
            raise _too_uncertain(
                estimate, f"may be off by {error:.3g} {unit}, above {field} of {limit:.3g}", limit
            )
    asked = max_error_m is not None or max_error_rad is not None
    if asked and min_level is not None and estimate.level < min_level:
        why = f"{estimate.backtests} backtests support the level {estimate.level:.4g} only"
        raise _too_uncertain(
            estimate,
            f"is not sure enough: {why}, below {min_level:.4g}; a longer history (cache_time_s) or "
            "a lower min_level helps",
            min_level,
        )
    return estimate


def _too_uncertain(estimate: Estimate, why: str, limit: float) -> TooUncertain:
    facts: dict[str, object] = {}
    message = f"{estimate.source_frame!r} in {estimate.target_frame!r} {why}"
    if estimate.limiting_link is not None:
        facts["parent_frame"], facts["frame"] = estimate.limiting_link
        message += "; most of it comes from the link from {!r} to {!r}".format(
            *estimate.limiting_link
        )
    return TooUncertain(
        f"{message}, carried on by at most {estimate.by_ns / 1e6:.4g} ms",
        target_frame=estimate.target_frame,
        source_frame=estimate.source_frame,
        stamp_ns=estimate.stamp_ns,
        error_m=estimate.error_m,
        error_rad=estimate.error_rad,
        limit=limit,
        by_ns=estimate.by_ns,
        **facts,
    )


class Estimator(Protocol[NoAnswer_co]):
    """What the methods of `TreeEstimates` need, so that others may have them as well."""

    def _now_ns(self) -> int: ...

    # The same methods of `_core_stubs.reads.Reads`, which say what they are called with.
    @property
    def _estimate(self) -> Callable[..., Estimate | NoAnswer_co]: ...
    @property
    def _estimate_columns(self) -> Callable[..., EstimateColumns | NoAnswer_co]: ...


class TreeEstimates(_core.Tree):
    """A base of `TransformTree`: its estimates. Shared trees and mirrors have its methods, too."""

    _now_ns: Callable[[], int] = time.time_ns

    def estimate_transform(
        self: Estimator[NoAnswer_co],
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
    ) -> Estimate | NoAnswer_co:
        """Estimate the pose of `source` in `target` at a time, now for example, and its error.

        Links are carried on beyond their newest samples. How wrong that may be is measured: the
        same question is answered for past instants, as far from their data, and compared with
        what came then. docs/how-to/estimate.md says what the bounds promise, and what they do not.

        Args:
            target: Frame to express the pose in.
            source: Frame whose pose is asked for.
            stamp_ns: Time in nanoseconds; None for now, by the server's real-time clock, or by this
                machine's if there is no server.
            level: Share of answers whose errors are within the bounds, above 0 and below 1. Those
                above 0.95 need a long history: 0.99 needs a `cache_time_s` of 60.
            max_by_s: How far a link may be carried beyond its newest sample, in seconds.
            max_error_m: Largest error of the position to accept, in metres; None for any.
            max_error_rad: Largest error of the orientation to accept, in radians; None for any.
            min_level: Level to insist on with a limit, if the history is too short for `level`;
                None for `level` itself.
            radius_m: Radius in metres of the body around the origin of `source` whose points
                `error_m` is to hold for.

        Returns:
            `X_target_source` in metres, and the bounds of its errors in metres and radians.

        Raises:
            TooUncertain: An error may be larger than its limit.
            ForwardExtrapolationException: A link ends more than `max_by_s` before the time.
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: An argument is invalid; `field` names it.

        Example:
            `tree.estimate_transform("map", "gripper", max_error_m=0.02).transform`
        """
        by_ns = max_by_ns(max_by_s)
        found = self._estimate(target, source, stamp_ns, self._now_ns(), level, by_ns, radius_m)
        if max_error_m is max_error_rad is min_level is None or not isinstance(found, Estimate):
            return found
        least = level if min_level is None else min_level
        return check(found, max_error_m, max_error_rad, least)

    def estimate_transforms(
        self: Estimator[NoAnswer_co],
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        radius_m: float = 0.0,
    ) -> EstimateArray | NoAnswer_co:
        """Estimate many poses and their errors in one call; each row is its own transaction.

        A row that fails does not raise: its `status` is the error's code, and the rest NaN.
        Example: `near = tree.estimate_transforms("map", arms, None).error_m < 0.02`

        Args:
            targets: Frames to express the poses in; one name stands for every row.
            sources: Frames whose poses are asked for; one name stands for every row.
            stamps_ns: (n,) times in nanoseconds; one int stands for every row, and None for now,
                as of `estimate_transform`.
            level: Share of answers whose errors are within the bounds, above 0 and below 1.
            max_by_s: How far a link may be carried beyond its newest sample, in seconds.
            radius_m: Radius in metres of the bodies that `error_m` is to hold for.

        Returns:
            The estimates of all rows.

        Raises:
            InvalidArgumentException: An argument is invalid, or the numbers of rows differ.
        """
        columns = self._estimate_columns(
            targets, sources, stamps_ns, self._now_ns(), level, max_by_ns(max_by_s), radius_m
        )
        if not isinstance(columns, tuple):
            return columns
        return EstimateArray.of_columns(columns, targets, sources)

    def set_motion_limits(
        self,
        child: str,
        *,
        max_speed_m_s: float | None = None,
        max_accel_m_s2: float | None = None,
        max_rate_rad_s: float | None = None,
        max_rate_accel_rad_s2: float | None = None,
        max_clock_error_s: float | None = None,
    ) -> None:
        """Declare what the link to a frame can do at most, for `estimate_transform`.

        The bounds of an estimate are then at least what the limits allow in the time that the link
        is carried on. If all links that move have limits of both kinds, the bounds are guaranteed.
        The error of a clock adds what the link moves in that time; if it is declared, a guarantee
        needs limits of speed and rate. Replaces all limits of the frame; without any it has none.

        Args:
            child: The link's child, which need not exist yet.
            max_speed_m_s: Speed of its origin in its parent, metres per second.
            max_accel_m_s2: Acceleration of its origin, metres per second squared.
            max_rate_rad_s: Angular velocity, radians per second.
            max_rate_accel_rad_s2: Angular acceleration, radians per second squared.
            max_clock_error_s: By how many seconds the clock that stamps the link's samples may be
                ahead or behind; finite, and 0 if left out.

        Raises:
            InvalidArgumentException: The name is invalid, a limit is negative or a whole number
                beyond the floats, or the error of the clock is not finite.

        Example:
            `tree.set_motion_limits("base_link", max_speed_m_s=1.0, max_rate_rad_s=1.5)`
        """
        limits = (max_speed_m_s, max_accel_m_s2, max_rate_rad_s, max_rate_accel_rad_s2)
        clock_error_s = 0.0 if max_clock_error_s is None else max_clock_error_s
        for field, limit in zip(MOTION_LIMITS, (*limits, clock_error_s), strict=True):
            if limit is not None and not (limit >= 0 and _is_float(limit)):
                raise must_be(field, "0 or more", limit)
        if math.isinf(clock_error_s):
            raise must_be("max_clock_error_s", "finite", clock_error_s)
        speed, accel, rate, rate_accel = (math.inf if each is None else each for each in limits)
        self._set_motion_limits(child, speed, accel, rate, rate_accel, clock_error_s)


def _is_float(value: float) -> bool:
    """False for whole numbers that no float can hold."""
    return value <= sys.float_info.max or value == math.inf
