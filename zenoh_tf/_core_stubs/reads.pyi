"""What trees and shared trees have: a stub that others import, not a module at run time."""

from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf._core import Budget
from zenoh_tf._core_stubs.estimates import Estimate, EstimateColumns
from zenoh_tf._core_stubs.transform import LatestTransform, Rows, StampedTransform

N = TypeVar("N")  # what stands for an answer that there is not: AskServer, or Never

T_co = TypeVar("T_co", covariant=True)

class _AskEstimate(Protocol[T_co]):
    def __call__(
        self,
        target_frame: str,
        source_frame: str,
        stamp_ns: int | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> T_co: ...

class Reads(Generic[N]):
    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform | N:
        """Return the pose of source in target at one time.

        Example: `tree.lookup_transform("map", "camera").transform.apply(points)` maps points from
        camera to map.

        Args:
            target: Frame to express coordinates in.
            source: Frame whose coordinates are given.
            stamp_ns: Time in nanoseconds; None means the latest common time of all links.
            timeout_s: Seconds to wait for a write that makes the answer possible.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.

        Returns:
            `X_target_source` in metres, with parent_frame target and child_frame source. Its
            `gap_ns` is not 0 if it was interpolated over a gap.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            ExtrapolationException: A link has no data for that time; its subclasses say why.
            GapTooLong: The samples of a link around that time are farther apart than `max_gap_s`.
            InvalidArgumentException: A name, the stamp, the time-out or the limit is invalid.
        """
    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform | N:
        """Return the pose of source at one time in target at another.

        The result is `X_target_fixed(target_stamp_ns) @ X_fixed_source(source_stamp_ns)`.

        Args:
            target: Frame to express coordinates in.
            target_stamp_ns: Time of target in nanoseconds; None means the latest common time of
                target and the fixed frame.
            source: Frame whose coordinates are given.
            source_stamp_ns: Time of source in nanoseconds; None as above, for source.
            fixed_frame: Frame that does not move between the two times.
            timeout_s: Seconds to wait for a write that makes the answer possible.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.

        Returns:
            `X_target_source` in metres, stamped with target's time; `gap_ns` as of
            `lookup_transform`.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects a frame with the fixed one.
            ExtrapolationException: A link has no data for its time.
            GapTooLong: The samples of a link around its time are farther apart than `max_gap_s`.
            InvalidArgumentException: A name, a stamp, the time-out or the limit is invalid.
        """
    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool | N:
        """Return whether `lookup_transform` would answer; a missing transform is no error.

        Args:
            target: Frame to express coordinates in.
            source: Frame whose coordinates are given.
            stamp_ns: Time in nanoseconds; None means the latest common time.
            timeout_s: Seconds to wait until it becomes possible.

        Raises:
            InvalidArgumentException: A name is not text, or the stamp or the time-out is invalid.
        """
    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform | N:
        """Return the pose of source in target from the newest sample of every link.

        Fresher than the latest common time, and not interpolated. Links may be of different
        commits; `lookup_latest_transform_xact` reads all at one instant.

        Args:
            target: Frame to express coordinates in.
            source: Frame whose coordinates are given.

        Returns:
            `X_target_source` in metres; `stamp_ns` is the oldest stamp used, in nanoseconds.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            InvalidArgumentException: A name is invalid.
        """
    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform | N:
        """Return what `lookup_latest_transform` returns, with all links read at one instant.

        Args:
            target: Frame to express coordinates in.
            source: Frame whose coordinates are given.

        Returns:
            `X_target_source` in metres; `stamp_ns` is the oldest stamp used, in nanoseconds.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            InvalidArgumentException: A name is invalid.
        """
    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform] | N:
        """Return several latest transforms, all read at the same instant.

        Args:
            pairs: (target, source) frames of each.

        Returns:
            `X_target_source` of each pair, in metres and in order; stamps in nanoseconds.

        Raises:
            LookupException: A frame does not exist, or a path is longer than `max_depth`.
            ConnectivityException: No path connects the frames of a pair.
            InvalidArgumentException: A name is invalid, or `pairs` does not hold pairs.
        """
    def latest_common_time(self, a: str, b: str) -> int | N | None:
        """Return the newest time, in nanoseconds, that all links between two frames can serve.

        Args:
            a: One frame.
            b: The other frame.

        Returns:
            The time in nanoseconds; None if all links between them are static.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            InvalidArgumentException: A name is invalid.
        """
    def frames(self) -> list[str] | N:
        """Return the names of all frames, in the order of their creation."""
    def parent(self, frame: str, stamp_ns: int | None = None) -> str | N | None:
        """Return a frame's parent.

        Args:
            frame: Name of the frame.
            stamp_ns: Time in nanoseconds; None means now, the newest link.

        Returns:
            The parent's name; None if the frame has none at that time.

        Raises:
            LookupException: The frame does not exist.
            InvalidArgumentException: The name or the stamp is invalid.
        """
    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str] | N:
        """Return the frames on the path from target to source, both included.

        Args:
            target: First frame.
            source: Last frame.
            stamp_ns: Time in nanoseconds; None means now, the newest links.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            ExtrapolationException: A link has no data for that time.
            InvalidArgumentException: A name or the stamp is invalid.
        """
    # What follows is internal to zenoh_tf and the server.
    def _velocity_record(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None,
        averaging_interval_ns: int,
        reference_frame: str | None,  # None: the observation frame
        reference_point: ArrayLike,
        reference_point_frame: str | None,  # None: the tracking frame
        max_gap_ns: int = -1,
    ) -> dict[str, Any] | N: ...  # Velocity's fields
    def _read_rows(
        self,
        names: Sequence[str],
        op: NDArray[np.uint8],
        target: NDArray[np.uint32],  # rows of names; out of range: InvalidArgumentException
        source: NDArray[np.uint32],
        stamp_ns: NDArray[np.int64],
        fixed: NDArray[np.uint32] | None = None,  # OP_FULL only
        source_stamp_ns: NDArray[np.int64] | None = None,  # OP_FULL only
        *,
        atomic: bool = False,  # every row in one snapshot; OP_LATEST is then as OP_LATEST_XACT
        versions: bool = False,  # also return what was read, for a transaction
        errors: bool = True,  # False: failed rows have only their status
        budget: Budget | None = None,  # charged before the rows are looked up
        max_gap_ns: int = -1,  # of all rows; see zenoh_tf.gap_limit
    ) -> Rows | N: ...
    def _lookup_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        max_gap_s: float | None = None,
    ) -> (  # status, stamps, poses, gaps
        tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]] | N
    ): ...
    def _deskew(  # see zenoh_tf.clouds.points
        self,
        points: NDArray[Any],  # float32 or float64, (rows, columns, 3), any strides
        stamps_ns: NDArray[np.int64],  # (rows, columns)
        out: NDArray[Any],  # as points
        source: str,
        fixed_frame: str,
        at_ns: int,
        max_gap_ns: int = -1,
    ) -> bool | N: ...  # False: nothing was written, as each time has to be looked up by itself
    def _startup_ns(self) -> tuple[int, int] | N | None: ...  # see Tree._begin_startup; None: over
    def _frame_record(self, name: str) -> dict[str, Any] | N: ...  # FrameInfo's fields
    def _ancestor_records(
        self, target: str, source: str, stamp_ns: int | None
    ) -> list[dict[str, Any]] | N: ...
    _estimate: _AskEstimate[Estimate | N]
    _estimate_record: _AskEstimate[dict[str, Any] | N]  # Estimate's fields
    def _estimate_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> EstimateColumns | N: ...
    def _set_motion_limits(  # inf: none
        self,
        child: str,
        speed: float,
        accel: float,
        rate: float,
        rate_accel: float,
        clock_error: float,
    ) -> None: ...
