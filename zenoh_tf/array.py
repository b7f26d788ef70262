"""Many transforms in columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from zenoh_tf._core import Transform

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class TransformArray:
    """The answers to many lookups, one row each.

    Attributes:
        status: (n,) uint8, 0 or the ``code`` of the error in place of an exception
            (``zenoh_tf.errors.BY_CODE``).
        stamps_ns: (n,) int64, the time of each answer.
        poses: (n, 7) float64 rows of x, y, z, qx, qy, qz, qw; the identity where ``status`` is
            not 0. Row i is ``X_target_source`` of lookup i.
    """

    status: NDArray[np.uint8]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]

    @property
    def translations(self) -> NDArray[np.float64]:
        """(n, 3), metres; a view."""
        return self.poses[:, :3]

    @property
    def rotations(self) -> NDArray[np.float64]:
        """(n, 4), quaternions (x, y, z, w); a view."""
        return self.poses[:, 3:]

    def __len__(self) -> int:
        return len(self.status)

    def __getitem__(self, row: int) -> Transform:
        """One row as a ``Transform``, whatever its status."""
        return Transform.from_pose(self.poses[row])
