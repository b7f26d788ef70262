"""What trees and shared trees have: a stub that others import, not a module at run time."""

from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf._core import Budget
from zenoh_tf._core_stubs.estimates import Estimate, EstimateColumns
from zenoh_tf._core_stubs.transform import Rows

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
    def _deskew(  # see zenoh_tf.points
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
