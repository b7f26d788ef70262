"""K: the transforms of a tree, applied to what tf2's conversion packages apply them to.

Both directions of one link are tested, as upstream does: the stored pose of B in A maps data from
B to A, and the lookup of A in B maps data from A to B.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike

from zenoh_tf import Transform

from .shorthand import NO_ROTATION, ORIGIN, Tree, assert_pose, look, put, rotation_error, yaw

TOLERANCE = 1e-6  # upstream allows 1e-3
HALF_TURN_X = (1.0, 0.0, 0.0, 0.0)
XYZ = (1.0, 2.0, 3.0)
RAW, A_TO_B = (11.0, 18.0, 27.0), (-9.0, 18.0, 27.0)
HALF = math.sqrt(0.5)


@pytest.fixture
def raw(tf: Tree) -> Transform:
    """The pose of B in A, as stored."""
    put(tf, "A", "B", 2, (10, 20, 30), HALF_TURN_X)
    return look(tf, "A", "B", 2).transform


@pytest.fixture
def a_to_b(raw: Transform, tf: Tree) -> Transform:
    """Return the transform that maps data from A to B."""
    return look(tf, "B", "A", 2).transform


def assert_close(result: ArrayLike, expected: ArrayLike) -> None:
    apart = np.abs(np.asarray(result, np.float64) - np.asarray(expected, np.float64))
    assert apart.max() <= TOLERANCE, f"{result!r}, not {expected!r}"


def test_K01_points(raw: Transform, a_to_b: Transform) -> None:
    """Points are rotated and translated, one or many in an array of any leading shape."""
    for dtype in (np.float64, np.float32):
        point = np.array(XYZ, dtype)
        assert_close(raw.apply(point), RAW)
        assert_close(a_to_b.apply(point), A_TO_B)
    polygon = np.array([XYZ] * 4)
    assert_close(raw.apply(polygon), [RAW] * 4)
    assert_close(a_to_b.apply(polygon.reshape(2, 2, 3)), np.full((2, 2, 3), A_TO_B))
    assert_close(a_to_b.apply(raw.apply(XYZ)), XYZ)


def test_K02_poses(raw: Transform, a_to_b: Transform) -> None:
    """The position of a pose is mapped as a point, its orientation is rotated."""
    pose = (*XYZ, *HALF_TURN_X)
    for transform, position in ((raw, RAW), (a_to_b, A_TO_B)):
        for result in (transform.apply_poses(pose), transform.apply_poses([pose] * 3)[2]):
            assert_close(result[:3], position)
            assert rotation_error(result[3:], NO_ROTATION) < TOLERANCE


def test_K03_vectors(raw: Transform, a_to_b: Transform) -> None:
    """A vector is rotated, and the translation has no effect on it."""
    for transform in (raw, a_to_b):
        assert_close(transform.apply_vectors(XYZ), (1, -2, -3))
        assert_close(transform.apply_vectors([[XYZ], [ORIGIN]]), [[(1.0, -2.0, -3.0)], [ORIGIN]])


def test_K04_quaternions(raw: Transform, a_to_b: Transform) -> None:
    """An orientation is rotated, given as the rotation of a pose or as a Transform."""
    turned = (0, -HALF, 0, HALF)
    for transform in (raw, a_to_b):
        as_pose = transform.apply_poses((*ORIGIN, *turned))
        as_transform = (transform @ Transform(rotation=turned)).rotation
        for result in (as_pose[3:], as_transform):
            assert rotation_error(result, (HALF, 0, -HALF, 0)) < TOLERANCE


def test_K05_transforms(raw: Transform, a_to_b: Transform) -> None:
    """A transform is mapped as a pose, by multiplication from the left."""
    inner = Transform(XYZ, HALF_TURN_X)
    assert_pose(raw @ inner, RAW, NO_ROTATION, TOLERANCE)
    assert_pose(a_to_b @ inner, A_TO_B, NO_ROTATION, TOLERANCE)
    for transform in (raw, a_to_b):
        assert_close((transform @ inner).pose(), transform.apply_poses(inner.pose()))


def test_K06_covariances(raw: Transform, a_to_b: Transform) -> None:
    """Both blocks of a pose's covariance are rotated, without a lever arm, as in tf2."""
    covariance = np.tile(np.arange(1.0, 7.0), (6, 1))
    row = np.array([1, -2, -3, 4, -5, -6])
    expected = np.array([row, -row, -row, row, -row, -row])
    for transform in (raw, a_to_b):
        assert_close(transform.apply_covariance(covariance), expected)
        assert_close(transform.apply_covariance(np.stack([covariance] * 2)), [expected] * 2)
    assert_close(covariance, np.tile(np.arange(1.0, 7.0), (6, 1)))


def test_K07_wrenches(tf: Tree) -> None:
    """A force moved to another origin adds its moment to the torque."""
    put(tf, "A", "B", 2, (0, -2, 0), yaw(-math.pi / 2))
    X_A_B = look(tf, "A", "B", 2).transform
    wrench, expected = (2, 1, 3, 2, 1, 3), (1, -2, 3, -5, -2, 5)
    assert_close(X_A_B.apply_wrench(wrench), expected)
    assert_close(X_A_B.apply_wrench([[wrench] * 2]), [[expected] * 2])
    X_B_A = look(tf, "B", "A", 2).transform
    assert_close(X_B_A.apply_wrench(expected), wrench)


def test_K08_point_by_frames(tf: Tree) -> None:
    """Into the target, from the source: the lookup's two names in this order."""
    put(tf, "a", "b", 2, (1, 0, 0), HALF_TURN_X)
    assert_close(look(tf, "b", "a", 2).transform.apply(XYZ), (0, -2, -3))
    assert_close(look(tf, "b", "a").transform.apply(XYZ), (0, -2, -3))
    assert_close(look(tf, "a", "b", 2).transform.apply((0, -2, -3)), XYZ)


@pytest.mark.parametrize(
    ("xyz", "q", "expected"),
    [
        ((300, 300, 300), NO_ROTATION, [[301, 302, 300], [310, 320, 330]]),
        (ORIGIN, HALF_TURN_X, [[1, -2, 0], [10, -20, -30]]),
        ((0, 0, 100), HALF_TURN_X, [[1, -2, 100], [10, -20, 70]]),
    ],
)
def test_K09_clouds(
    tf: Tree, xyz: tuple[float, ...], q: tuple[float, ...], expected: list[list[float]]
) -> None:
    """A cloud's coordinates are mapped as points; other columns and the input stay unchanged."""
    put(tf, "base", "lidar", 2, xyz, q)
    answer = look(tf, "base", "lidar", 2)
    assert answer.parent_frame == "base"
    cloud = np.array([[1, 2, 0, 7], [10, 20, 30, 8]], np.float32)  # x, y, z, intensity
    before = cloud.copy()
    moved = answer.transform.apply(cloud[:, :3])
    assert_close(moved, expected)
    assert not np.shares_memory(moved, cloud)
    np.testing.assert_array_equal(cloud, before)
    assert answer.transform.apply(np.empty((0, 3))).shape == (0, 3)


def test_K10_velocities(tf: Tree) -> None:
    """[Q] Decision: the identity leaves a twist as it is; a lever arm adds omega x r to it."""
    put(tf, "a", "a2", 2)
    put(tf, "a", "b", 2, (0, -2, 0), yaw(-math.pi / 2))
    twist = (2, 1, 3, 2, 1, 3)
    assert_close(look(tf, "a", "a2", 2).transform.apply_twist(twist), twist)
    X_a_b = look(tf, "a", "b", 2).transform
    assert_close(X_a_b.apply_twist(twist), (-5, -2, 5, 1, -2, 3))
    assert_close(look(tf, "b", "a", 2).transform.apply_twist((-5, -2, 5, 1, -2, 3)), twist)
