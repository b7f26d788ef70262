"""The native tree's methods for estimates: a stub that `_core.pyi` imports, not a module at run time."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf.estimate import Estimate

#: status, stamps, poses, error_m, error_rad, level, backtests, by_ns
EstimateColumns = tuple[
    NDArray[np.uint8],
    NDArray[np.int64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.int64],
    NDArray[np.int64],
]

class Estimates:
    def _estimate(
        self,
        kind: type[Estimate],
        target_frame: str,
        source_frame: str,
        stamp_ns: int | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> Estimate: ...
    def _estimate_record(
        self,
        target_frame: str,
        source_frame: str,
        stamp_ns: int | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> dict[str, Any]: ...  # Estimate's fields
    def _estimate_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,  # None: now_ns
        now_ns: int,
        level: float,
        max_by_ns: int,
        radius_m: float,
    ) -> EstimateColumns: ...
    def _set_motion_limits(  # inf: none
        self, child: str, speed: float, accel: float, rate: float, rate_accel: float
    ) -> None: ...
    def _motion_limits(self) -> dict[str, tuple[float, float, float, float]]: ...
