"""Transform and the values around it. Its laws are in test_transform_laws.py."""

import pickle
from typing import Any

import numpy as np
import pytest

from zenoh_tf import (
    InvalidArgumentException,
    LatestTransform,
    StampedTransform,
    Transform,
    TransformArray,
)


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
    [
        np.eye(3),
        np.diag([1, 1, -1, 1]),
        np.diag([2, 1, 1, 1]),
        np.ones((4, 4)),
        np.eye(4) * np.nan,
        np.eye(4, dtype=complex),
        "abc",
        None,
    ],
)
def test_what_is_no_rigid_matrix(matrix: Any) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        Transform.from_matrix(matrix)
    assert caught.value.field == "matrix"


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
