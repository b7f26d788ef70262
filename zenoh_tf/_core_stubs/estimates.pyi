"""The native tree's estimates: a stub that `_core.pyi` imports, not a module at run time."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from zenoh_tf._core_stubs.transform import Transform

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

class Estimate:
    """A pose at a time, mostly beyond the newest samples, with bounds of its errors.

    The bounds are those of the same question about past instants, whose answers are known by now;
    docs/how-to/estimate.md says what they promise, and what they do not.

    Attributes:
        target_frame: Frame in which the pose is.
        source_frame: Frame whose pose it is.
        transform: ``X_target_source`` at `stamp_ns`, in metres.
        stamp_ns: Time of the pose in nanoseconds.
        error_m: Bound of the position's error in metres, at the origin of the source frame, or at
            all points within the radius asked for. Infinite if there is nothing to compare with.
        error_rad: Bound of the orientation's error in radians.
        level: Share of the answers that are within both bounds. Below the level asked for if the
            history is too short.
        backtests: Number of independent past instants that the bounds rest on.
        basis: ``"backtest"``; ``"limits"`` if all links that move have declared limits of motion,
            so that the bounds are guaranteed; ``"static"`` if no link moves.
        by_ns: How far the worst link is carried beyond its newest sample, in nanoseconds; 0 if all
            links are interpolated.
        limiting_link: Parent and child of the link that adds most to the error; None if none does.
        predictor: How each link beyond its newest sample is carried on, by its child: ``"hold"`` or
            ``"twist"``.
    """

    __match_args__: ClassVar[tuple[str, ...]]
    def __init__(
        self,
        target_frame: str,
        source_frame: str,
        transform: Transform,
        stamp_ns: int,
        error_m: float,
        error_rad: float,
        level: float,
        backtests: int,
        basis: str,
        by_ns: int,
        limiting_link: tuple[str, str] | None,
        predictor: dict[str, str],
    ) -> None: ...
    @property
    def target_frame(self) -> str: ...
    @property
    def source_frame(self) -> str: ...
    @property
    def transform(self) -> Transform: ...
    @property
    def stamp_ns(self) -> int: ...
    @property
    def error_m(self) -> float: ...
    @property
    def error_rad(self) -> float: ...
    @property
    def level(self) -> float: ...
    @property
    def backtests(self) -> int: ...
    @property
    def basis(self) -> str: ...
    @property
    def by_ns(self) -> int: ...
    @property
    def limiting_link(self) -> tuple[str, str] | None: ...
    @property
    def predictor(self) -> dict[str, str]: ...
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...
