"""Conversions to SciPy and back, and SciPy as an independent check of Transform."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from zenoh_tf import (
    BackwardExtrapolationException,
    InvalidArgumentException,
    Transform,
    TransformArray,
)

spatial: Any = pytest.importorskip("scipy.spatial.transform", reason="SciPy is not installed")
from zenoh_tf.scipy import (  # noqa: E402 - only where SciPy is
    array_from_rigid_transform,
    from_rigid_transform,
    from_rotation,
    to_rigid_transform,
    to_rotation,
)

HAS_RIGID = hasattr(spatial, "RigidTransform")
rigid = pytest.mark.skipif(not HAS_RIGID, reason="this SciPy has no RigidTransform")
RNG = np.random.default_rng(7)


def random_transform() -> Transform:
    q = RNG.normal(size=4)
    return Transform(RNG.uniform(-10, 10, 3), q / np.linalg.norm(q))


SOME = [Transform(), Transform((1, 2, 3), (1, 0, 0, 0)), *(random_transform() for _ in range(8))]
POSES = np.array([a.pose() for a in SOME])
ARRAY = TransformArray(np.zeros(len(SOME), np.uint8), np.arange(len(SOME)), POSES)
POINTS = RNG.normal(size=(5, 3))


def test_rotations_out_and_back() -> None:
    for a in SOME:
        rotation = to_rotation(a)
        assert isinstance(rotation, spatial.Rotation)
        np.testing.assert_allclose(rotation.apply(POINTS), a.apply_vectors(POINTS), atol=1e-13)
        back = from_rotation(rotation, a.translation)
        np.testing.assert_allclose(back.pose(), a.pose(), rtol=1e-15, atol=1e-15)
        assert from_rotation(rotation).translation.tolist() == [0, 0, 0]


def test_rotations_made_by_scipy() -> None:
    """Roll, pitch, yaw about fixed axes: as docs/reference/notation.md names them."""
    rotation = spatial.Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
    a = from_rotation(rotation, (1, 2, 3))
    moved = rotation.apply(POINTS) + np.array([1, 2, 3])
    np.testing.assert_allclose(a.apply(POINTS), moved, atol=1e-14)
    both = from_rotation(rotation * rotation)
    np.testing.assert_allclose(both.matrix()[:3, :3], (a @ a).matrix()[:3, :3], atol=1e-14)


def test_stacks_of_rotations() -> None:
    stack = to_rotation(ARRAY)
    assert len(stack) == len(SOME)
    for rotation, a in zip(stack, SOME, strict=True):
        np.testing.assert_allclose(rotation.as_matrix(), a.matrix()[:3, :3], atol=1e-14)
    none = TransformArray(np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros((0, 7)))
    assert len(to_rotation(none)) == 0


def test_rows_that_failed_raise() -> None:
    status = np.array([0, 8], np.uint8)
    poses = np.array([SOME[1].pose(), [np.nan] * 7])
    array = TransformArray(status, np.zeros(2, np.int64), poses)
    for convert in (to_rotation, to_rigid_transform) if HAS_RIGID else (to_rotation,):
        with pytest.raises(BackwardExtrapolationException, match="row 1 of 2"):
            convert(array)
    stack = to_rotation(array[array.ok]).as_matrix()
    np.testing.assert_allclose(stack, [SOME[1].matrix()[:3, :3]], atol=1e-15)


def test_roll_pitch_yaw_are_scipys_euler_angles_about_fixed_axes() -> None:
    for angles in RNG.uniform(-1, 1, (50, 3)) * (np.pi, np.pi / 2, np.pi):
        rotation = spatial.Rotation.from_euler("xyz", angles)  # small letters: fixed axes
        a = Transform.from_rpy(*angles)
        np.testing.assert_allclose((rotation.inv() * to_rotation(a)).magnitude(), 0, atol=1e-14)
        np.testing.assert_allclose(a.rpy(), rotation.as_euler("xyz"), atol=1e-12)


def test_one_transform_is_not_a_stack() -> None:
    for rows in (slice(0, 1), slice(0, 4)):
        with pytest.raises(InvalidArgumentException) as caught:
            from_rotation(to_rotation(ARRAY)[rows])
        assert caught.value.field == "rotation"
    with pytest.raises(InvalidArgumentException) as caught:
        from_rotation(spatial.Rotation.identity(), (1, 2))
    assert caught.value.field == "translation"


@rigid
def test_rigid_transforms_out_and_back() -> None:
    for a in SOME:
        there = to_rigid_transform(a)
        np.testing.assert_allclose(there.as_matrix(), a.matrix(), atol=1e-14)
        np.testing.assert_allclose(there.apply(POINTS), a.apply(POINTS), atol=1e-13)
        back = from_rigid_transform(there)
        np.testing.assert_allclose(back.matrix(), a.matrix(), atol=1e-14)
        for b in SOME:
            product = from_rigid_transform(there * to_rigid_transform(b))
            np.testing.assert_allclose(product.matrix(), (a @ b).matrix(), atol=1e-13)
        inverse = from_rigid_transform(there.inv())
        np.testing.assert_allclose(inverse.matrix(), a.inverse().matrix(), atol=1e-13)


@rigid
def test_stacks_of_rigid_transforms() -> None:
    stack = to_rigid_transform(ARRAY)
    assert len(stack) == len(SOME)
    for one, a in zip(stack, SOME, strict=True):
        np.testing.assert_allclose(one.as_matrix(), a.matrix(), atol=1e-14)
    for rows in (slice(0, 1), slice(0, 4)):
        with pytest.raises(InvalidArgumentException):
            from_rigid_transform(stack[rows])


@pytest.mark.parametrize(
    ("code", "complaint"),
    [
        ("sys.modules['scipy'] = None; import zenoh_tf.scipy", "pip install scipy"),
        (
            "import scipy.spatial.transform as t; vars(t).pop('RigidTransform', None); "
            "import zenoh_tf.scipy as z; z.to_rigid_transform(zenoh_tf.Transform())",
            "to_rigid_transform needs SciPy 1.16 or later",
        ),
    ],
)
def test_without_scipy_or_with_an_old_one(code: str, complaint: str) -> None:
    command = [sys.executable, "-c", "import sys, zenoh_tf; " + code]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: ")
    assert complaint in last


@rigid
def test_a_stack_comes_back() -> None:
    poses = [Transform.from_rpy(0.1 * i, -0.2, 1.0, (i, 2 * i, -i)) for i in range(5)]
    given = TransformArray(np.zeros(5, np.uint8), np.arange(5), np.array([X.pose() for X in poses]))
    found = array_from_rigid_transform(to_rigid_transform(given), given.stamps_ns)
    np.testing.assert_array_equal(found.stamps_ns, given.stamps_ns)
    np.testing.assert_allclose(np.asarray(found), np.asarray(given), atol=1e-12)
    assert len(array_from_rigid_transform(to_rigid_transform(poses[0]))) == 1
