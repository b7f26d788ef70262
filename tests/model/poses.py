"""Arithmetic of poses for the oracle, in textbook form.

A pose is (x, y, z, qx, qy, qz, qw). Nothing here comes from the product.
"""

from __future__ import annotations

import math

Pose = tuple[float, float, float, float, float, float, float]
Quaternion = tuple[float, float, float, float]
IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product of two quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    return (-q[0], -q[1], -q[2], q[3])


def rotated(q: Quaternion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return q p q*, with the point as a pure quaternion."""
    return product(product(q, (x, y, z, 0.0)), conjugate(q))[:3]


def compose(ab: Pose, bc: Pose) -> Pose:
    """Return X_ac from X_ab and X_bc."""
    x, y, z = rotated(ab[3:], *bc[:3])
    return (ab[0] + x, ab[1] + y, ab[2] + z, *product(ab[3:], bc[3:]))


def inverse(ab: Pose) -> Pose:
    """Return X_ba from X_ab."""
    q = conjugate(ab[3:])
    return (*rotated(q, -ab[0], -ab[1], -ab[2]), *q)


def normalised(pose: Pose) -> Pose:
    norm = math.sqrt(sum(v * v for v in pose[3:]))
    x, y, z, w = (v / norm for v in pose[3:])
    return (*pose[:3], x, y, z, w)


def interpolated(a: Pose, b: Pose, ratio: float) -> Pose:
    """Interpolate: translation linearly, rotation by slerp along the shorter arc."""
    x, y, z = (p + (q - p) * ratio for p, q in zip(a[:3], b[:3], strict=True))
    dot = sum(p * q for p, q in zip(a[3:], b[3:], strict=True))
    sign = -1.0 if dot < 0 else 1.0  # q and -q are one rotation
    angle = math.acos(min(abs(dot), 1.0))
    if angle == 0.0:
        return (x, y, z, *a[3:])
    wa = math.sin((1.0 - ratio) * angle) / math.sin(angle)
    wb = math.sin(ratio * angle) / math.sin(angle) * sign
    qx, qy, qz, qw = (wa * p + wb * q for p, q in zip(a[3:], b[3:], strict=True))
    return (x, y, z, qx, qy, qz, qw)
