"""Conversions to and from ``scipy.spatial.transform`` (``pip install 'zenoh-tf[scipy]'``).

The conventions are the same: quaternions are (x, y, z, w), ``X_parent_child`` maps coordinates
in child to coordinates in parent, and SciPy's ``A * B`` is ``A @ B`` here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zenoh_tf import Transform, TransformArray

try:
    from scipy.spatial.transform import Rotation
except ImportError as error:
    raise ImportError(
        f"zenoh_tf.scipy needs SciPy, which cannot be imported ({error}); "
        "install it with: pip install scipy",
        name="scipy",
    ) from error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray
    from scipy.spatial.transform import RigidTransform

__all__ = [
    "array_from_rigid_transform",
    "from_rigid_transform",
    "from_rotation",
    "to_rigid_transform",
    "to_rotation",
]


def to_rotation(transforms: Transform | TransformArray) -> Rotation:
    """Return the rotation of a transform, or the stack of rotations of an array.

    ``to_rotation(X_parent_child).apply(v)`` maps directions (3,) or (n, 3) in child's axes to
    parent's. Quaternions keep their signs and are normalised.

    Args:
        transforms: One transform, or an array; `array[array.ok]` leaves out rows that failed.

    Raises:
        TransformException: A row of the array failed; the class is that of its error.
    """
    if isinstance(transforms, TransformArray):
        return Rotation.from_quat(transforms.raise_for_status().rotations)
    return Rotation.from_quat(transforms.rotation)


def from_rotation(
    rotation: Rotation,
    translation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
) -> Transform:
    """Return ``X_parent_child`` of a rotation and a translation.

    Args:
        rotation: One rotation, child's axes in parent.
        translation: (3,) child's origin in parent, metres.

    Raises:
        InvalidArgumentException: ``rotation`` is a stack, or ``translation`` is not (3,).
    """
    return Transform(translation, rotation.as_quat())


def to_rigid_transform(transforms: Transform | TransformArray) -> RigidTransform:
    """Return a transform, or the stack of an array, as SciPy's ``RigidTransform``.

    Args:
        transforms: One transform, or an array; `array[array.ok]` leaves out rows that failed.

    Raises:
        TransformException: A row of the array failed; the class is that of its error.
        ImportError: SciPy is older than 1.16, and has no ``RigidTransform``.
    """
    try:
        from scipy.spatial.transform import RigidTransform  # noqa: PLC0415 - not in every SciPy
    except ImportError as error:
        message = f"to_rigid_transform needs SciPy 1.16 or later ({error})"
        raise ImportError(message, name="scipy") from error
    rotation = to_rotation(transforms)
    if isinstance(transforms, TransformArray):
        return RigidTransform.from_components(transforms.translations, rotation)
    return RigidTransform.from_components(transforms.translation, rotation)


def from_rigid_transform(transform: RigidTransform) -> Transform:
    """Return ``X_parent_child`` of a ``RigidTransform``; the quaternion's sign is SciPy's.

    Args:
        transform: One transform, metres.

    Raises:
        InvalidArgumentException: ``transform`` is a stack.
    """
    translation, rotation = transform.as_components()
    return from_rotation(rotation, translation)


def array_from_rigid_transform(
    transforms: RigidTransform, stamps_ns: ArrayLike = 0
) -> TransformArray:
    """Return an array of a stack, the inverse of `to_rigid_transform`.

    Args:
        transforms: (n,) transforms, metres.
        stamps_ns: (n,) their times in nanoseconds, or one for all.
    """
    translations, rotations = transforms.as_components()
    poses = np.hstack([np.atleast_2d(translations), np.atleast_2d(rotations.as_quat())])
    stamps = np.broadcast_to(np.asarray(stamps_ns, np.int64), len(poses)).copy()
    return TransformArray(np.zeros(len(poses), np.uint8), stamps, poses)
