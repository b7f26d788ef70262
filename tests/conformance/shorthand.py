"""Short helpers for the tests: seconds for stamps, numbers for poses, tolerant comparisons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

#: The tree under test; both classes have the same methods.
Tree = TransformTree | TransformClient

#: x, y, z or a quaternion's x, y, z, w.
Numbers = Sequence[float] | NDArray[np.float64]

#: How the tree is reached: in this process, by queries, or from the server's memory.
REACHES = ("embedded", "remote", "shared")


def _modes(*reaches: str) -> list[Any]:
    """Parameters that name a reach and a concurrency control; all but the default are slow."""
    slow = (
        pytest.param(f"{reach}-{control}", marks=pytest.mark.slow)
        for reach in reaches
        for control in ("2pl", "giant")
    )
    return [*(f"{reach}-optimistic" for reach in reaches), *slow]


MODES = _modes(*REACHES)
#: For tests about the network: ``@pytest.mark.parametrize("mode", REMOTE, indirect=True)``.
REMOTE = _modes("remote")

ORIGIN = (0.0, 0.0, 0.0)
NO_ROTATION = (0.0, 0.0, 0.0, 1.0)


def ns(seconds: float) -> int:
    """A time in nanoseconds."""
    return round(seconds * 1e9)


def yaw(angle: float) -> tuple[float, float, float, float]:
    """The rotation by `angle` (radians) about z, as (x, y, z, w)."""
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


def stamped(
    parent: str,
    child: str,
    seconds: float,
    xyz: Numbers = ORIGIN,
    q: Numbers = NO_ROTATION,
) -> StampedTransform:
    """The pose of `child` in `parent` is `xyz`, `q` at `seconds`."""
    return StampedTransform(parent, child, ns(seconds), Transform(xyz, q))


def put(
    tf: Tree,
    parent: str,
    child: str,
    seconds: float,
    xyz: Numbers = ORIGIN,
    q: Numbers = NO_ROTATION,
    *,
    static: bool = False,
    authority: str = "",
) -> bool:
    """Set a transform; return False if it was dropped as too old."""
    return tf.set_transform(stamped(parent, child, seconds, xyz, q), authority, static)


def put_ns(
    tf: Tree,
    parent: str,
    child: str,
    stamp_ns: int,
    xyz: Numbers = ORIGIN,
    q: Numbers = NO_ROTATION,
) -> bool:
    """Like `put`, with the time in nanoseconds."""
    return tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform(xyz, q)))


def look(tf: Tree, target: str, source: str, seconds: float | None = None) -> StampedTransform:
    """Return the pose of `source` in `target` at `seconds`, or at their latest common time."""
    return tf.lookup_transform(target, source, None if seconds is None else ns(seconds))


def can(tf: Tree, target: str, source: str, seconds: float | None = None) -> bool:
    """Return whether `look` would succeed."""
    return tf.can_transform(target, source, None if seconds is None else ns(seconds))


def x_of(answer: StampedTransform) -> float:
    """Return the x translation of a result, for tests along one axis."""
    return answer.transform.pose()[0]


def rotation_error(a: Numbers, b: Numbers) -> float:
    """Return the largest component difference of two quaternions; q and -q are equal."""
    p, q = np.asarray(a), np.asarray(b)
    return float(min(np.abs(p - q).max(), np.abs(p + q).max()))


def assert_pose(
    answer: StampedTransform | Transform,
    xyz: Numbers,
    q: Numbers = NO_ROTATION,
    tolerance: float = 1e-6,
) -> None:
    """The pose is `xyz`, `q`, each coordinate within `tolerance`, up to the quaternion's sign."""
    transform = answer.transform if isinstance(answer, StampedTransform) else answer
    pose = transform.pose()
    apart = np.abs(np.subtract(pose[:3], xyz)).max()
    assert apart <= tolerance, f"translation {pose[:3]}, not {tuple(xyz)}"
    assert rotation_error(pose[3:], q) <= tolerance, f"rotation {pose[3:]}, not {tuple(q)}"
