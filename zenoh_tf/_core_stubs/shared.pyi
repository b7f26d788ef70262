"""The part of the native module `_core` that reads trees of other processes."""

import enum
from collections.abc import Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf._core import Budget, Tree
from zenoh_tf._core_stubs.estimates import Estimate, EstimateColumns
from zenoh_tf._core_stubs.transform import LatestTransform, Rows, StampedTransform

LAYOUT: tuple[int, int]  # version and hash of the layout that this build writes and reads

class RegionRefused(ValueError): ...

class LeaseKeeper:
    # Holds a shared tree's lease from a thread of its own, which Python cannot delay. Only for an
    # owner whose tree no other process can take over while this one lives, however long it stops.
    def __init__(self, tree: Tree) -> None: ...
    def end(self) -> None: ...

@final
class AskServer(enum.Enum):
    def __bool__(self) -> Literal[False]: ...  # zenoh_tf.shared_tree

    BUSY = ...
    LAPSED = ...
    WAITING = ...
    UNREADABLE = ...
    ABSENT = ...

class SharedTree:
    # A tree of another process; see zenoh_tf.shared_tree.
    def __init__(self, fd: int) -> None: ...  # does not keep it; RegionRefused says why not
    @property
    def instance(self) -> str: ...
    @property
    def lease_left_s(self) -> float: ...

    # As Tree's, or AskServer.
    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> StampedTransform | AskServer: ...
    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> StampedTransform | AskServer: ...
    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool | AskServer: ...
    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform | AskServer: ...
    def lookup_latest_transform_xact(
        self, target: str, source: str
    ) -> LatestTransform | AskServer: ...
    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform] | AskServer: ...
    def latest_common_time(self, a: str, b: str) -> int | AskServer | None: ...
    def frames(self) -> list[str] | AskServer: ...
    def parent(self, frame: str, stamp_ns: int | None = None) -> str | AskServer | None: ...
    def chain(
        self, target: str, source: str, stamp_ns: int | None = None
    ) -> list[str] | AskServer: ...
    def _velocity_record(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None,
        averaging_interval_ns: int,
        reference_frame: str | None,
        reference_point: ArrayLike,
        reference_point_frame: str | None,
    ) -> dict[str, Any] | AskServer: ...
    def _estimate_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> EstimateColumns | AskServer: ...
    def _estimate(
        self,
        target_frame: str,
        source_frame: str,
        stamp_ns: int | None,
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> Estimate | AskServer: ...
    def _estimate_record(
        self,
        target_frame: str,
        source_frame: str,
        stamp_ns: int | None,
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> dict[str, Any] | AskServer: ...
    def _set_motion_limits(
        self,
        child: str,
        speed: float,
        accel: float,
        rate: float,
        rate_accel: float,
        clock_error: float,
    ) -> None: ...
    def _read_rows(
        self,
        names: Sequence[str],
        op: NDArray[np.uint8],
        target: NDArray[np.uint32],
        source: NDArray[np.uint32],
        stamp_ns: NDArray[np.int64],
        fixed: NDArray[np.uint32] | None = None,
        source_stamp_ns: NDArray[np.int64] | None = None,
        *,
        atomic: bool = False,
        versions: bool = False,
        errors: bool = True,
        budget: Budget | None = None,
    ) -> Rows | AskServer: ...
    def _lookup_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]] | AskServer: ...
    def _frame_record(self, name: str) -> dict[str, Any] | AskServer: ...
    def _deskew(
        self,
        points: NDArray[Any],
        stamps_ns: NDArray[np.int64],
        out: NDArray[Any],
        source: str,
        fixed_frame: str,
        at_ns: int,
    ) -> bool | AskServer: ...
    def _ancestor_records(
        self, target: str, source: str, stamp_ns: int | None
    ) -> list[dict[str, Any]] | AskServer: ...
