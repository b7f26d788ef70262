"""The native module's values: a stub that `_core.pyi` imports, not a module at run time.

`X_parent_child` is the pose of child in parent; it maps coordinates in child to coordinates in
parent. A pose row is (x, y, z, qx, qy, qz, qw), in metres and with a unit quaternion.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: The answers of `Tree._read_rows`.
Rows = tuple[
    NDArray[np.uint8],  # status: 0 or errors.BY_CODE
    # stamp_ns; latest forms: the oldest used; OP_COMMON_TIME: NO_STAMP if all are static
    NDArray[np.int64],
    NDArray[np.int64],  # newest_stamp_ns (latest forms only)
    NDArray[np.float64],  # (n, 7) pose rows, NaN where status != 0
    list[tuple[int, Any]],  # (row, TransformException), as far as the budget has room
    tuple[list[str], NDArray[np.uint64]] | None,  # read set: frame names, versions
    NDArray[np.int64] | None,  # gap_ns; None if all are 0
]

class Transform:
    """A rigid transform: a rotation, then a translation. Immutable.

    As `X_parent_child` it is the pose of child in parent, and maps coordinates in child to
    coordinates in parent. `X_ac = X_ab @ X_bc` composes. A tree checks values when they are set;
    this class does not.

    Args:
        translation: (3,) x, y, z in metres.
        rotation: (4,) unit quaternion (x, y, z, w), not (w, x, y, z): (1, 0, 0, 0) is a half turn
            about x.

    Raises:
        InvalidArgumentException: An argument does not have that many numbers.
    """

    def __init__(
        self,
        translation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        rotation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0, 1.0),
    ) -> None: ...
    @staticmethod
    def identity() -> Transform:
        """Return the transform that changes nothing: 0 metres, no rotation."""
    @staticmethod
    def from_pose(pose: Sequence[float] | NDArray[np.float64]) -> Transform:
        """Return the transform of a pose row, the inverse of `pose()`.

        Args:
            pose: (7,) x, y, z in metres, then the unit quaternion qx, qy, qz, qw.

        Raises:
            InvalidArgumentException: `pose` is not 7 numbers.
        """
    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Transform:
        """Return the transform of a homogeneous matrix, the inverse of `matrix()`.

        Args:
            matrix: (4, 4), row-major; translation in metres.

        Raises:
            InvalidArgumentException: `matrix` has another shape or is not rigid.
        """
    @staticmethod
    def from_rpy(
        roll: float,
        pitch: float,
        yaw: float,
        translation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        *,
        degrees: bool = False,
    ) -> Transform:
        """Return the transform with these angles about the fixed axes x, y, z, in that order.

        This is ROS's `setRPY`: the rotation is Rz(yaw) Ry(pitch) Rx(roll).
        Example: `Transform.from_rpy(0, 0, math.pi / 2, (1, 0, 0))` is 1 m ahead, facing left.

        Args:
            roll: Angle about x, in radians.
            pitch: Angle about y, in radians.
            yaw: Angle about z, in radians.
            translation: (3,) x, y, z in metres.
            degrees: The angles are in degrees.

        Raises:
            InvalidArgumentException: `translation` is not 3 numbers.
        """
    @property
    def translation(self) -> NDArray[np.float64]:
        """The translation: a new (3,) float64 array, metres. Read-only."""
    @property
    def rotation(self) -> NDArray[np.float64]:
        """The rotation: a new (4,) float64 array, a quaternion (x, y, z, w). Read-only."""
    def pose(self) -> tuple[float, float, float, float, float, float, float]:
        """Return (x, y, z, qx, qy, qz, qw) as Python floats, the translation in metres."""
    def rpy(self) -> tuple[float, float, float]:
        """Return (roll, pitch, yaw) in radians, the inverse of `from_rpy`.

        Roll and yaw are in [-pi, pi], pitch in [-pi/2, pi/2]. At a pitch of +-pi/2 only a
        combination of roll and yaw is determined; roll is then 0, as in tf2.
        """
    def matrix(self) -> NDArray[np.float64]:
        """Return the homogeneous matrix: (4, 4) float64, row-major, translation in metres."""
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return `matrix()` to NumPy: `numpy.asarray(X)`."""
    def inverse(self) -> Transform:
        """Return `X_ba` of this `X_ab`. The rotation must be of unit length."""
    def apply(self, points: ArrayLike, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return points that are given in child, expressed in parent: R p + t.

        Args:
            points: (..., 3) real numbers, metres; any strides. float32 and float64 with up to three
                axes are read where they are.
            out: Array of the points' shape to write to, float32 or float64; an array that is used
                again saves the time to allocate one. It may be `points` itself, but must not
                overlap with it otherwise.

        Returns:
            `out`, or a new float64 array.

        Raises:
            InvalidArgumentException: `points` has another shape or is not of real numbers, or `out`
                does not fit.
        """
    def apply_vectors(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Return directions that are given in child's axes, in parent's axes: R v.

        For normals, displacements and fields: the translation has no effect, any unit stays.

        Args:
            vectors: (..., 3) real numbers, any strides. Not modified.

        Raises:
            InvalidArgumentException: `vectors` has another shape or is not of real numbers.
        """
    def apply_poses(self, poses: ArrayLike) -> NDArray[np.float64]:
        """Return poses of bodies that are given in child, expressed in parent.

        Each row is `X_parent_body = X_parent_child @ X_child_body`. Quaternions are neither
        normalised nor changed in sign.

        Args:
            poses: (..., 7) rows x, y, z (metres), qx, qy, qz, qw. Not modified.

        Raises:
            InvalidArgumentException: `poses` has another shape or is not of real numbers.
        """
    def apply_covariance(self, covariance: ArrayLike) -> NDArray[np.float64]:
        """Return covariances of poses that are given in child, expressed in parent.

        The result is diag(R, R) C diag(R, R)^T, as in tf2_geometry_msgs. There is no lever arm:
        the errors are of the body's position and of its rotation about itself. The transform
        counts as exact.

        Args:
            covariance: (..., 6, 6), rows and columns x, y, z (metres) and rotations about x, y, z
                (radians), in the axes of child, as in ROS's PoseWithCovariance. Not modified.

        Raises:
            InvalidArgumentException: `covariance` has another shape or is not of real numbers.
        """
    def apply_wrench(self, wrench: ArrayLike) -> NDArray[np.float64]:
        """Return wrenches at child's origin as the equal wrenches at parent's origin.

        force' = R force, torque' = R torque + t x (R force), as in tf2_geometry_msgs.

        Args:
            wrench: (..., 6) rows fx, fy, fz (newtons), tx, ty, tz (newton metres), in child's
                axes. Not modified.

        Raises:
            InvalidArgumentException: `wrench` has another shape or is not of real numbers.
        """
    def apply_twist(self, twist: ArrayLike) -> NDArray[np.float64]:
        """Return twists of a body at child's origin as those of the same body at parent's origin.

        angular' = R w, linear' = R v + t x (R w). The linear part is the velocity of the body's
        point at the frame's origin. The observer stays the same: child and parent count as fixed
        to each other.

        Args:
            twist: (..., 6) rows vx, vy, vz (m/s), wx, wy, wz (rad/s), in child's axes.
                Not modified.

        Raises:
            InvalidArgumentException: `twist` has another shape or is not of real numbers.
        """
    def __matmul__(self, other: Transform) -> Transform:
        """Return `X_ac = X_ab @ X_bc`."""
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

class StampedTransform:
    """The pose of a child frame in its parent at a time: `X_parent_child`. Immutable.

    Args:
        parent_frame: Name of the parent.
        child_frame: Name of the child.
        stamp_ns: The time, integer nanoseconds.
        transform: `X_parent_child`, in metres.
        gap_ns: The gap of a lookup's answer; see the attribute.

    Raises:
        InvalidArgumentException: A name is not text, or the stamp does not fit.
    """

    def __init__(
        self,
        parent_frame: str,
        child_frame: str,
        stamp_ns: int,
        transform: Transform,
        *,
        gap_ns: int = 0,
    ) -> None: ...
    @property
    def parent_frame(self) -> str:
        """The name of the parent frame; of a lookup's answer, the target."""
    @property
    def child_frame(self) -> str:
        """The name of the child frame; of a lookup's answer, the source."""
    @property
    def stamp_ns(self) -> int:
        """The time of the transform in nanoseconds."""
    @property
    def transform(self) -> Transform:
        """The pose of child in parent, `X_parent_child`, in metres."""
    @property
    def gap_ns(self) -> int:
        """The longest gap that a lookup interpolated over, in nanoseconds; 0 if there is none.

        A gap is an interval between two samples of a link that is longer than 5 times the mean of
        the other intervals in its history, or than a second as long as there is no other. The pose
        inside a gap is a guess. Transforms are compared without it.
        """
    def _repr_html_(self) -> str: ...
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...

class LatestTransform(StampedTransform):
    """A transform made of the newest sample of every link. Immutable.

    Static links have no time and do not count; where all links are static, both stamps are 0.

    Args:
        parent_frame: Name of the lookup's target.
        child_frame: Name of the lookup's source.
        stamp_ns: The oldest stamp that was used, nanoseconds: every link is at least this fresh.
        transform: `X_parent_child`, in metres.
        newest_stamp_ns: The newest stamp that was used, nanoseconds.

    Raises:
        InvalidArgumentException: A name is not text, or a stamp does not fit.
    """

    def __init__(
        self,
        parent_frame: str,
        child_frame: str,
        stamp_ns: int,
        transform: Transform,
        newest_stamp_ns: int,
    ) -> None: ...
    @property
    def newest_stamp_ns(self) -> int:
        """The newest stamp that was used, in nanoseconds; `stamp_ns` is the oldest."""
