"""The laws of Transform, each over every kind of transform that tends to break one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from zenoh_tf import StampedTransform, Transform, TransformTree

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)


def turn(angle: float, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Array:
    """The quaternion of a turn by `angle` radians about `axis`, a unit vector."""
    return np.array([*np.sin(angle / 2) * np.array(axis), np.cos(angle / 2)])


def random_transform() -> Transform:
    q = RNG.normal(size=4)
    return Transform(RNG.uniform(-10, 10, 3), q / np.linalg.norm(q))


ALL = {
    "identity": Transform(),
    "translation": Transform((1, 2, 3)),
    "nearly-identity": Transform((1e-9, -1e-9, 1e-9), turn(1e-9, (0.6, 0.0, 0.8))),
    "half-turn-x": Transform((10, 20, 30), (1, 0, 0, 0)),
    "half-turn-y": Transform((-1, 0, 4), (0, 1, 0, 0)),
    "half-turn-z": Transform((0, 5, 0), (0, 0, 1, 0)),
    "nearly-half-turn": Transform((1, 0, 0), turn(np.pi - 1e-9, (0.0, 0.6, -0.8))),
    "quarter-turns": Transform((-1, 0, 4), (0.5, -0.5, 0.5, -0.5)),
    "far": Transform((1e6, -1e6, 1e6), turn(1.0, (0.6, 0.0, 0.8))),
    "far-and-tiny": Transform((1e6, -1e6, 1e-6), turn(1e-9)),
    "tiny": Transform((1e-12, 0, -1e-12), turn(2.0, (0.0, 0.6, 0.8))),
    **{f"random-{i}": random_transform() for i in range(6)},
}
each = pytest.mark.parametrize("a", ALL.values(), ids=ALL.keys())
PAIRS = [(a, b) for a in ALL.values() for b in ALL.values()]


def assert_close(actual: Array, expected: Array, *sizes: Array | float) -> None:
    """Equal but for rounding at the scale of the largest number that went in or came out."""
    scale = max([1.0, *(float(np.abs(s).max(initial=0)) for s in (actual, expected, *sizes))])
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-14 * scale)


def assert_same(actual: Transform, expected: Transform, *sizes: Transform) -> None:
    scales = [s.translation for s in (actual, expected, *sizes)]
    assert_close(actual.translation, expected.translation, *scales)
    assert_close(actual.matrix()[:3, :3], expected.matrix()[:3, :3])


def parts(a: Transform) -> tuple[Array, Array]:
    """The rotation matrix and the translation."""
    matrix = a.matrix()
    return matrix[:3, :3], matrix[:3, 3]


@each
def test_the_inverse_undoes(a: Transform) -> None:
    assert_same(a @ a.inverse(), Transform.identity(), a)
    assert_same(a.inverse() @ a, Transform.identity(), a)
    assert_same(a.inverse().inverse(), a)


@each
def test_the_identity_changes_nothing(a: Transform) -> None:
    assert a @ Transform.identity() == a
    assert Transform.identity() @ a == a


@each
def test_products_associate_and_are_matrix_products(a: Transform) -> None:
    for b, c in PAIRS:
        assert_same((a @ b) @ c, a @ (b @ c), a, b, c)
    for b in ALL.values():
        assert_close((a @ b).matrix(), a.matrix() @ b.matrix(), a.translation, b.translation)
        assert_same((a @ b).inverse(), b.inverse() @ a.inverse(), a, b)


@each
def test_the_rotation_matrix_is_one(a: Transform) -> None:
    rotation, translation = parts(a)
    assert_close(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(translation, a.translation)
    np.testing.assert_array_equal(a.matrix()[3], [0, 0, 0, 1])


@each
def test_matrix_and_back(a: Transform) -> None:
    for matrix in (a.matrix(), a.matrix().tolist(), np.asfortranarray(a.matrix())):
        back = Transform.from_matrix(matrix)
        assert_same(back, a)
        # The same quaternion too, up to its sign.
        sign = np.sign(back.rotation @ a.rotation)
        assert_close(back.rotation * sign, a.rotation)


@each
def test_both_signs_of_a_quaternion_are_one_rotation(a: Transform) -> None:
    other = Transform(a.translation, -a.rotation)
    np.testing.assert_array_equal(other.matrix(), a.matrix())
    points = RNG.normal(size=(5, 3))
    np.testing.assert_array_equal(other.apply(points), a.apply(points))
    assert_same(Transform.from_matrix(other.matrix()), a)
    assert_same(other.inverse(), a.inverse())


@each
def test_points_go_as_the_matrix_says(a: Transform) -> None:
    points = RNG.normal(size=(5, 3))
    rotation, translation = parts(a)
    assert_close(a.apply(points), points @ rotation.T + translation)
    assert_close(a.inverse().apply(a.apply(points)), points, translation)
    for b in ALL.values():
        assert_close((a @ b).apply(points), a.apply(b.apply(points)), a.translation, b.translation)


@each
def test_vectors_are_differences_of_points(a: Transform) -> None:
    vectors = RNG.normal(size=(5, 3))
    differences = a.apply(vectors) - a.apply(np.zeros(3))
    assert_close(a.apply_vectors(vectors), differences, a.translation)
    lengths = np.linalg.norm(a.apply_vectors(vectors), axis=-1)
    assert_close(lengths, np.linalg.norm(vectors, axis=-1))


@each
def test_poses_go_as_products(a: Transform) -> None:
    bodies = list(ALL.values())
    poses = a.apply_poses([b.pose() for b in bodies])
    for pose, b in zip(poses, bodies, strict=True):
        # Not bit for bit: a compiler may fuse products and sums here and not there.
        assert_close(pose, np.array((a @ b).pose()), a.translation, b.translation)
    assert_close(np.linalg.norm(poses[:, 3:], axis=-1), np.ones(len(bodies)))


@each
def test_covariances_turn_by_blocks(a: Transform) -> None:
    half = RNG.normal(size=(4, 6, 6))
    covariance = half @ half.transpose(0, 2, 1)
    turned = a.apply_covariance(covariance)
    rotation, _ = parts(a)
    both = np.kron(np.eye(2), rotation)
    assert_close(turned, both @ covariance @ both.T)
    assert_close(turned, turned.transpose(0, 2, 1))
    for block in (slice(0, 3), slice(3, 6), slice(0, 6)):
        before, after = (np.linalg.eigvalsh(c[:, block, block]) for c in (covariance, turned))
        np.testing.assert_allclose(after, before, rtol=1e-10, atol=1e-12)
    # No block leaks into another, symmetric or not.
    for i, j in np.ndindex(2, 2):
        one = np.zeros((6, 6))
        one[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = RNG.normal(size=(3, 3))
        assert_close(a.apply_covariance(one), both @ one @ both.T)


@each
def test_wrenches_and_twists_go_by_the_adjoint(a: Transform) -> None:
    wrenches, twists = RNG.normal(size=(2, 5, 6))
    rotation, t = parts(a)
    force, torque = wrenches[:, :3] @ rotation.T, wrenches[:, 3:] @ rotation.T
    linear, angular = twists[:, :3] @ rotation.T, twists[:, 3:] @ rotation.T
    moved_wrenches = np.concatenate([force, torque + np.cross(t, force)], axis=1)
    moved_twists = np.concatenate([linear + np.cross(t, angular), angular], axis=1)
    assert_close(a.apply_wrench(wrenches), moved_wrenches, t)
    assert_close(a.apply_twist(twists), moved_twists, t)
    for b in ALL.values():
        sizes = a.translation, b.translation
        assert_close(
            (a @ b).apply_wrench(wrenches), a.apply_wrench(b.apply_wrench(wrenches)), *sizes
        )
        assert_close((a @ b).apply_twist(twists), a.apply_twist(b.apply_twist(twists)), *sizes)


@each
def test_power_is_the_same_in_every_frame(a: Transform) -> None:
    wrenches, twists = RNG.normal(size=(2, 5, 6))

    def power(w: Array, v: Array) -> Array:
        return np.asarray((w * v).sum(axis=-1))

    there = power(a.apply_wrench(wrenches), a.apply_twist(twists))
    assert_close(there, power(wrenches, twists), a.translation)


@each
def test_a_twist_is_the_velocity_of_the_body(a: Transform) -> None:
    """Points of a body that turns and moves, after a short time, seen from either frame."""
    twist, dt = RNG.normal(size=6), 1e-6
    points = RNG.normal(size=(5, 3))

    def velocity(of: Array, at: Array) -> Array:
        return np.asarray(of[:3] + np.cross(of[3:], at))

    displaced = a.apply(points + dt * velocity(twist, points)) - a.apply(points)
    assert_close(displaced, dt * velocity(a.apply_twist(twist), a.apply(points)), a.translation)


SMALL = [0.0, 1e-12, 1e-9, 1e-6, 1e-3]
#: The series replaces sines from an angle of 0.0894.
BETWEEN = [0.0893, 0.0895, 1.0, 3.0]
NEARLY_PI = [np.pi - 1e-3, np.pi - 1e-6, np.pi - 1e-9]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("angle", SMALL + BETWEEN + NEARLY_PI)
def test_interpolation_turns_evenly(angle: float, sign: int) -> None:
    """Between two samples a turn is in proportion to time, to the last digits of it."""
    tree, axis = TransformTree(), (0.6, 0.0, -0.8)
    q = turn(angle, axis)
    tree.set_transform(StampedTransform("map", "base", 0, Transform()))
    tree.set_transform(StampedTransform("map", "base", 1000, Transform((2, 4, 6), sign * q)))
    for stamp_ns in (0, 1, 250, 500, 999, 1000):
        got = tree.lookup_transform("map", "base", stamp_ns).transform
        expected = turn(angle * stamp_ns / 1000, axis)
        rotation = got.rotation * np.sign(got.rotation @ expected)
        np.testing.assert_allclose(rotation, expected, rtol=1e-13, atol=1e-30)
        assert_close(got.translation, np.array([2, 4, 6]) * stamp_ns / 1000)


@each
def test_interpolation_between_any_two(a: Transform) -> None:
    """From everywhere, by a small and by a great turn."""
    for angle in (1e-9, 1.0, np.pi - 1e-9):
        step = Transform((1, 0, 0), turn(angle, (0.0, 0.6, 0.8)))
        tree = TransformTree()
        tree.set_transform(StampedTransform("map", "base", 0, a))
        tree.set_transform(StampedTransform("map", "base", 1000, a @ step))
        for stamp_ns in (0, 300, 1000):
            got = tree.lookup_transform("map", "base", stamp_ns).transform
            q = turn(angle * stamp_ns / 1000, (0.0, 0.6, 0.8))
            expected = a @ Transform((stamp_ns / 1000, 0, 0), q)
            assert_same(got, expected, a)
            assert np.linalg.norm(got.rotation) == pytest.approx(1.0, abs=1e-14)


def test_halfway_through_a_half_turn() -> None:
    """Both directions are as short: it goes one of them, a quarter turn from either end."""
    for end in np.eye(4)[:3]:
        tree = TransformTree()
        tree.set_transform(StampedTransform("map", "base", 0, Transform()))
        tree.set_transform(StampedTransform("map", "base", 1000, Transform(rotation=end)))
        halfway = tree.lookup_transform("map", "base", 500).transform.rotation
        expected = np.sqrt(0.5) * (end + np.eye(4)[3])
        np.testing.assert_allclose(np.abs(halfway), expected, atol=1e-15)
