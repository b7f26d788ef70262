"""The native tree. Shapes: poses are (x, y, z, qx, qy, qz, qw) rows of float64."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

class Transform:
    def __init__(
        self,
        translation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        rotation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0, 1.0),
    ) -> None: ...
    @staticmethod
    def identity() -> Transform: ...
    @staticmethod
    def from_pose(pose: Sequence[float] | NDArray[np.float64]) -> Transform: ...
    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Transform: ...
    @property
    def translation(self) -> NDArray[np.float64]: ...
    @property
    def rotation(self) -> NDArray[np.float64]: ...
    def pose(self) -> tuple[float, float, float, float, float, float, float]: ...
    def matrix(self) -> NDArray[np.float64]: ...
    def inverse(self) -> Transform: ...
    # What is given in child, expressed in parent. Any leading shape; the input is not modified.
    def apply(self, points: ArrayLike) -> NDArray[np.float64]: ...  # (..., 3): R p + t
    def apply_vectors(self, vectors: ArrayLike) -> NDArray[np.float64]: ...  # (..., 3): R v
    # (..., 7) rows x, y, z, qx, qy, qz, qw: self @ each
    def apply_poses(self, poses: ArrayLike) -> NDArray[np.float64]: ...
    # (..., 6, 6), order x, y, z, rx, ry, rz: diag(R, R) C diag(R, R)^T, no lever arm
    def apply_covariance(self, covariance: ArrayLike) -> NDArray[np.float64]: ...
    # (..., 6) rows force, torque: R force, R torque + t x (R force)
    def apply_wrench(self, wrench: ArrayLike) -> NDArray[np.float64]: ...
    # (..., 6) rows linear, angular: R v + t x (R w), R w
    def apply_twist(self, twist: ArrayLike) -> NDArray[np.float64]: ...
    def __matmul__(self, other: Transform) -> Transform: ...
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

class StampedTransform:
    def __init__(
        self, parent_frame: str, child_frame: str, stamp_ns: int, transform: Transform
    ) -> None: ...
    @property
    def parent_frame(self) -> str: ...
    @property
    def child_frame(self) -> str: ...
    @property
    def stamp_ns(self) -> int: ...
    @property
    def transform(self) -> Transform: ...
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

class LatestTransform(StampedTransform):
    def __init__(
        self,
        parent_frame: str,
        child_frame: str,
        stamp_ns: int,
        transform: Transform,
        newest_stamp_ns: int,
    ) -> None: ...
    @property
    def newest_stamp_ns(self) -> int: ...

# What a row of `Tree.read_rows` asks for.
OP_AT: int  # source in target at stamp_ns
OP_COMMON: int  # the same at the latest common time
OP_LATEST: int  # newest of every link, links may be of different commits
OP_LATEST_XACT: int  # the same, atomically
OP_COMMON_TIME: int  # only the latest common time, in the answer's stamp
OP_FULL: int  # source at source_stamp_ns in target at stamp_ns, through fixed; NO_STAMP: latest
NO_STAMP: int  # INT64_MIN, "no time given"; an ordinary row may not carry it

#: The answers of `Tree.read_rows`.
Rows = tuple[
    NDArray[np.uint8],  # status: 0 or errors.BY_CODE
    # stamp_ns; latest forms: the oldest used; OP_COMMON_TIME: NO_STAMP if all are static
    NDArray[np.int64],
    NDArray[np.int64],  # newest_stamp_ns (latest forms only)
    NDArray[np.float64],  # (n, 7) poses; identity where status != 0
    list[tuple[int, Any]],  # (row, TransformException), for every row with a status
    tuple[list[str], NDArray[np.uint64]] | None,  # read set: frame names, versions
]

# Transforms as names (each once) and the columns parent, child (rows of names), stamp_ns, pose.
def columns_of(
    stampeds: Sequence[StampedTransform],
) -> tuple[
    list[str],
    NDArray[np.uint32],
    NDArray[np.uint32],
    NDArray[np.int64],
    NDArray[np.float64],
]: ...

class Tree:
    def __init__(
        self,
        cache_time_s: float = 10.0,
        concurrency: Literal["optimistic", "2pl", "giant"] = "optimistic",
        *,
        max_frames: int = 1 << 20,
        max_samples_per_frame: int = 1 << 16,
        max_name_bytes: int = 255,
        max_depth: int = 1000,
        one_authority_per_frame: bool = False,
        time_jump: Literal["reject", "clear"] = "reject",
    ) -> None: ...
    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> bool: ...
    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None: ...
    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> StampedTransform: ...
    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> StampedTransform: ...
    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool: ...
    def lookup_latest_transform(self, target: str, source: str) -> LatestTransform: ...
    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform: ...
    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]: ...
    def latest_common_time(self, a: str, b: str) -> int | None: ...
    def velocity_record(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None,
        averaging_interval_ns: int,
        reference_frame: str | None,  # None: the observation frame
        reference_point: Sequence[float] | NDArray[np.float64],
        reference_point_frame: str | None,  # None: the tracking frame
    ) -> dict[str, Any]: ...
    def read_rows(
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
    ) -> Rows: ...
    def commit_rows(
        self,
        names: Sequence[str],
        parent: NDArray[np.uint32],
        child: NDArray[np.uint32],
        stamp_ns: NDArray[np.int64],
        pose: NDArray[np.float64],  # (n, 7)
        *,
        authority: str = "",
        static: bool = False,
        drop_old: bool = False,  # True: too old rows are dropped; False: they refuse the whole
        read_names: Sequence[str] = (),
        read_versions: NDArray[np.uint64] | None = None,  # moved: TransactionConflict
    ) -> NDArray[np.uint8]: ...  # 1 stored, 0 dropped as too old
    def lookup_columns(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.int64] | None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.float64]]: ...
    def frames(self) -> list[str]: ...
    def frame_record(self, name: str) -> dict[str, Any]: ...  # FrameInfo's fields
    def authority_records(self) -> list[dict[str, Any]]: ...  # AuthorityInfo's fields
    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None: ...
    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]: ...
    def clear(self, keep_static: bool = True) -> None: ...
    def reset(self) -> None:
        """Drop every frame at one instant: all samples, static links and names.

        The tree is then as new, apart from its counters and authorities. A name that was ever
        used keeps counting against `max_frames`. To keep the names, use `clear(False)`.

        Example:
            >>> tree.reset()
            >>> tree.frames()
            []
        """
    def remove_frame(self, name: str, subtree: bool = False) -> None: ...
    def stats(self) -> dict[str, int]: ...

class WaitQueue:
    """Where woken rows of `WaitingRows` come together, to be served by one thread."""

    def take(self) -> list[int] | None:
        """Sleeps until rows are woken and asks them again. The tokens of those `WaitingRows`
        that are over now, each once; None after `close`."""
    def close(self) -> None: ...

class WaitingRows:
    """Lookups that wait, each row for itself, without a thread."""

    def start(self) -> bool:
        """Asks for the first time. True: all are over already; no token will come."""
    def cancel(self) -> None: ...
    def result(self, waited_s: float) -> Rows:
        """As `Tree.read_rows`; rows that still wait get what they would get now."""

def waiting_rows(
    tree: Tree,
    queue: WaitQueue,
    token: int,
    names: Sequence[str],
    op: NDArray[np.uint8],
    target: NDArray[np.uint32],
    source: NDArray[np.uint32],
    stamp_ns: NDArray[np.int64],
    fixed: NDArray[np.uint32] | None = None,
    source_stamp_ns: NDArray[np.int64] | None = None,
) -> WaitingRows: ...
