"""Transform and the values around it. Its laws are in test_transform_laws.py."""

import importlib.metadata
import math
import pickle
from typing import Any

import numpy as np
import pytest

import zenoh_tf
import zenoh_tf_client
import zenoh_tf_server
from zenoh_tf import (
    InvalidArgumentException,
    LatestTransform,
    StampedTransform,
    Transform,
)


def test_pose_and_columns() -> None:
    a = Transform((1, 2, 3), (0, 0, 0.6, 0.8))
    assert a.pose() == (1, 2, 3, 0, 0, 0.6, 0.8)
    np.testing.assert_array_equal(a.translation, [1, 2, 3])
    np.testing.assert_array_equal(a.rotation, [0, 0, 0.6, 0.8])
    for column in (a.translation, a.rotation):  # transforms do not change
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 9
    with pytest.raises(AttributeError):
        setattr(a, "translation", (0, 0, 0))  # noqa: B010 - mypy knows that it cannot be done


def test_angles_in_degrees() -> None:
    turned = Transform.from_rpy(10, -20, 90, (1, 2, 3), degrees=True)
    assert turned == Transform.from_rpy(
        math.radians(10), math.radians(-20), math.radians(90), (1, 2, 3)
    )
    np.testing.assert_allclose(np.degrees(turned.rpy()), [10, -20, 90])


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


def test_reprs_evaluate_to_the_same_value() -> None:
    a = Transform((0.1, -1e-300, 1 / 3), (0, 0, 0.6, 0.8))
    s = StampedTransform("map", "it's", -5, a)
    for value in (a, s, LatestTransform("map", "base", 5, a, 9)):
        assert eval(repr(value)) == value
    assert repr(Transform()) == (
        "Transform(translation=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0, 1.0))"
    )


@pytest.mark.parametrize(
    ("angles", "rotation"),
    [
        # tf2::Quaternion::setRPY: x, y, z, w
        ((0, 0, 0), (0, 0, 0, 1)),
        ((0.2, 0, 0), (np.sin(0.1), 0, 0, np.cos(0.1))),
        ((0, 0.2, 0), (0, np.sin(0.1), 0, np.cos(0.1))),
        ((0, 0, 0.2), (0, 0, np.sin(0.1), np.cos(0.1))),
        ((np.pi / 2, np.pi / 2, 0), (0.5, 0.5, -0.5, 0.5)),
        ((np.pi / 2, 0, np.pi / 2), (0.5, 0.5, 0.5, 0.5)),
        ((0, np.pi / 2, np.pi / 2), (-0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_from_rpy_is_tf2s_set_rpy(angles: Any, rotation: Any) -> None:
    roll, pitch, yaw = angles
    a = Transform.from_rpy(roll, pitch, yaw, translation=(1, 2, 3))
    np.testing.assert_allclose(a.rotation, rotation, atol=1e-15)
    np.testing.assert_array_equal(a.translation, [1, 2, 3])
    assert a == Transform.from_rpy(roll, pitch, yaw, (1, 2, 3))


def test_rpy_is_the_inverse_of_from_rpy() -> None:
    random = np.random.default_rng(5)
    for angles in random.uniform(-1, 1, (200, 3)) * (np.pi, np.pi / 2, np.pi):
        for sign in (1, -1):
            a = Transform.from_rpy(*angles)
            np.testing.assert_allclose(
                Transform((0, 0, 0), sign * a.rotation).rpy(), angles, atol=1e-12
            )


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-6])
def test_rpy_in_gimbal_lock(pitch: float, off: float) -> None:
    """Near a pitch of +-90 degrees the angles still give the rotation, to its last digits."""
    a = Transform.from_rpy(0.3, pitch - np.sign(pitch) * off, -0.8)
    angles = a.rpy()
    if off == 0.0:
        assert angles[0] == 0.0
    assert angles[1] == pytest.approx(pitch - np.sign(pitch) * off, abs=1e-15)
    again = Transform.from_rpy(*angles)
    np.testing.assert_allclose(again.matrix(), a.matrix(), atol=1e-14)


def test_rpy_needs_numbers() -> None:
    with pytest.raises(TypeError):
        Transform.from_rpy("a", 0, 0)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentException) as caught:
        Transform.from_rpy(0, 0, 0, (1, 2))
    assert caught.value.field == "translation"


def test_every_package_tells_its_version() -> None:
    installed = importlib.metadata.version("zenoh-tf")
    for package in (zenoh_tf, zenoh_tf_client, zenoh_tf_server):
        assert package.__version__ == installed
