"""In and out of ``scipy.spatial.transform``; needs SciPy (``pip install 'zenoh-tf[scipy]'``).

Both sides mean the same by the same numbers: quaternions are (x, y, z, w), ``X_parent_child``
takes coordinates in child to coordinates in parent, and SciPy's ``A * B`` is ``A @ B`` here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

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

    import numpy as np
    from numpy.typing import NDArray
    from scipy.spatial.transform import RigidTransform

__all__ = ["from_rigid_transform", "from_rotation", "to_rigid_transform", "to_rotation"]


def to_rotation(transforms: Transform | TransformArray) -> Rotation:
    """The rotation of a transform, or a stack of those of n transforms.

    ``to_rotation(X_parent_child).apply(v)`` takes directions (3,) or (n, 3) in child's axes to
    parent's. Quaternions keep their signs, and are normalised.

    Rows of an array that are errors (``status`` is not 0) are the identity, as in ``poses``.
    """
    if isinstance(transforms, TransformArray):
        return Rotation.from_quat(transforms.rotations)
    return Rotation.from_quat(transforms.rotation)


def from_rotation(
    rotation: Rotation,
    translation: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
) -> Transform:
    """``X_parent_child`` from its rotation, and where child's origin lies in parent, in metres.

    Raises:
        InvalidArgumentException: ``rotation`` is a stack, or ``translation`` is not (3,).
    """
    return Transform(translation, rotation.as_quat())


def to_rigid_transform(transforms: Transform | TransformArray) -> RigidTransform:
    """The same transform, or a stack of n transforms, as SciPy's class for both parts.

    Rows of an array that are errors (``status`` is not 0) are the identity, as in ``poses``.

    Raises:
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
    """``X_parent_child`` from SciPy's transform of the same meaning.

    Of the quaternion's two signs it has the one that SciPy gives.

    Raises:
        InvalidArgumentException: ``transform`` is a stack.
    """
    translation, rotation = transform.as_components()
    return from_rotation(rotation, translation)
