"""The laws of Transform, and the values around it."""

import pickle

import numpy as np
import pytest

from zenoh_tf import (
    InvalidArgumentException,
    LatestTransform,
    StampedTransform,
    Transform,
    TransformArray,
)

RNG = np.random.default_rng(7)


def random_transform() -> Transform:
    q = RNG.normal(size=4)
    return Transform(RNG.uniform(-10, 10, 3), q / np.linalg.norm(q))


SOME = [
    Transform(),
    Transform((1, 2, 3)),
    Transform(rotation=(1, 0, 0, 0)),
    Transform((-1, 0, 4), (0.5, -0.5, 0.5, -0.5)),
    Transform((1e6, -1e6, 1e-6), (0, 0, 1e-9, 1)),
    *(random_transform() for _ in range(20)),
]


def assert_same(a: Transform, b: Transform) -> None:
    np.testing.assert_allclose(a.matrix(), b.matrix(), atol=1e-9)


@pytest.mark.parametrize("a", SOME)
def test_inverse_and_identity(a: Transform) -> None:
    assert_same(a @ a.inverse(), Transform.identity())
    assert_same(a.inverse() @ a, Transform())
    assert_same(a @ Transform(), a)
    assert_same(Transform() @ a, a)


def test_products_are_matrix_products() -> None:
    for a, b, c in zip(SOME, SOME[1:], SOME[2:], strict=False):
        np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            ((a @ b) @ c).matrix(), (a @ (b @ c)).matrix(), rtol=1e-9, atol=1e-8
        )


@pytest.mark.parametrize("a", SOME)
def test_matrix_and_back(a: Transform) -> None:
    assert a.matrix().shape == (4, 4)
    assert_same(Transform.from_matrix(a.matrix()), a)
    assert_same(Transform.from_matrix(a.matrix().tolist()), a)


@pytest.mark.parametrize("shape", [(3,), (1, 3), (5, 3), (2, 4, 3), (0, 3)])
def test_apply(shape: tuple[int, ...]) -> None:
    points = RNG.normal(size=shape)
    before = points.copy()
    for a in SOME[:8]:
        moved = a.apply(points)
        assert moved.shape == shape
        rotation, translation = a.matrix()[:3, :3], a.matrix()[:3, 3]
        np.testing.assert_allclose(moved, points @ rotation.T + translation, atol=1e-9)
    np.testing.assert_array_equal(points, before)


def test_apply_takes_strided_and_integer_points() -> None:
    a = SOME[3]
    points = np.arange(24).reshape(4, 6)[::2, ::2]
    np.testing.assert_allclose(a.apply(points), a.apply(points.astype(float).copy()))
    np.testing.assert_allclose(a.apply([1, 2, 3]), a.apply(np.array([1.0, 2.0, 3.0])))


def test_pose_and_columns() -> None:
    a = Transform((1, 2, 3), (0, 0, 0.6, 0.8))
    assert a.pose() == (1, 2, 3, 0, 0, 0.6, 0.8)
    np.testing.assert_array_equal(a.translation, [1, 2, 3])
    np.testing.assert_array_equal(a.rotation, [0, 0, 0.6, 0.8])
    a.translation[0] = 9  # a copy: transforms do not change
    assert a.pose()[0] == 1
    with pytest.raises(AttributeError):
        setattr(a, "translation", (0, 0, 0))  # noqa: B010 - mypy knows that it cannot be done


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (((1, 2),), "translation"),
        ((None,), "translation"),
        (("abc",), "translation"),
        (((1, 2, 3), (0, 0, 1)), "rotation"),
        (((1, 2, "x"),), "translation"),
    ],
)
def test_what_is_no_transform(arguments: tuple[object, ...], field: str) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        Transform(*arguments)  # type: ignore[arg-type]
    assert caught.value.field == field


@pytest.mark.parametrize(
    "matrix",
    [np.eye(3), np.diag([1, 1, -1, 1]), np.diag([2, 1, 1, 1]), np.ones((4, 4)), np.eye(4) * np.nan],
)
def test_what_is_no_rigid_matrix(matrix: np.ndarray) -> None:
    with pytest.raises(InvalidArgumentException):
        Transform.from_matrix(matrix)


def test_apply_refuses_other_shapes() -> None:
    for points in (1.0, [1, 2], [[1, 2, 3, 4]]):
        with pytest.raises(InvalidArgumentException) as caught:
            Transform().apply(points)
        assert caught.value.field == "points"


def test_values_compare_hash_print_and_pickle() -> None:
    a = Transform((1, 2, 3), (0, 0, 0.6, 0.8))
    s = StampedTransform("map", "base", 5, a)
    latest = LatestTransform("map", "base", 5, a, 9)
    for value in (a, s, latest):
        copy = pickle.loads(pickle.dumps(value))
        assert copy == value
        assert hash(copy) == hash(value)
        assert type(value).__name__ in repr(value)
    assert s != StampedTransform("map", "base", 6, a)
    assert a != Transform((1, 2, 3))
    assert isinstance(latest, StampedTransform)
    assert (s.parent_frame, s.child_frame, s.stamp_ns, s.transform) == ("map", "base", 5, a)


def test_stamps_are_whole_nanoseconds_of_64_bits() -> None:
    for stamp in (1.5, "5", None, 2**63, -(2**63)):
        with pytest.raises(InvalidArgumentException) as caught:
            StampedTransform("a", "b", stamp, Transform())  # type: ignore[arg-type]
        assert caught.value.field == "stamp_ns"
    assert StampedTransform("a", "b", np.int64(5), Transform()).stamp_ns == 5  # type: ignore[arg-type]


def test_transform_array() -> None:
    poses = np.array([[1, 2, 3, 0, 0, 0, 1.0], [4, 5, 6, 1, 0, 0, 0]])
    array = TransformArray(np.zeros(2, np.uint8), np.array([7, 8]), poses)
    assert len(array) == 2
    np.testing.assert_array_equal(array.translations, poses[:, :3])
    np.testing.assert_array_equal(array.rotations, poses[:, 3:])
    assert array[1] == Transform((4, 5, 6), (1, 0, 0, 0))
