"""I: velocities of one frame in another."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import BackwardExtrapolationException, Velocity

from .shorthand import ORIGIN, Tree, ns, put, stamped, yaw

T = 100.0  # upstream uses the current time
STEPS_PER_S = 10
WINDOW_S = 0.1
OBSERVERS = ("foo", "child", "parent")
#: The middle of each of the six seconds, in which bar moves or turns in different directions.
MIDDLES = (0.5, 1.5, 2.5, 3.5, 4.5, 5.5)


def assert_twist(
    velocity: Velocity,
    linear: ArrayLike,
    angular: ArrayLike = ORIGIN,
    tolerance: float = 1e-6,
) -> None:
    assert np.abs(velocity.linear - np.asarray(linear)).max() <= tolerance, velocity
    assert np.abs(velocity.angular - np.asarray(angular)).max() <= tolerance, velocity


def legs(directions: Sequence[tuple[int, int]]) -> list[tuple[float, NDArray[np.float64]]]:
    """Times from T on and what has been covered by then: a second along each (axis, sign)."""
    covered = np.zeros(3)
    result = []
    for step in range(1, STEPS_PER_S * len(directions) + 1):
        axis, sign = directions[min(step // STEPS_PER_S, len(directions) - 1)]
        if step > 1:
            covered[axis] += sign / STEPS_PER_S
        result.append((T + step / STEPS_PER_S, covered.copy()))
    return result


def rpy(angles: ArrayLike) -> tuple[float, float, float, float]:
    """Roll, pitch, yaw about the fixed axes as (x, y, z, w), as tf2's setRPY."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(np.divide(angles, 2)), np.cos(np.divide(angles, 2))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def put_offsets(tf: Tree, parent_z: float) -> None:
    put(tf, "foo", "child", 0, (1, 0, 0), static=True)
    put(tf, "parent", "foo", 0, (0, 0, parent_z), static=True)


def test_I01_linear_velocity(tf: Tree) -> None:
    """A frame that moves without turning has the same velocity for every observer at rest."""
    put_offsets(tf, 1)
    square = [(0, 1), (1, 1), (0, -1), (1, -1), (2, 1), (2, -1)]
    tf.set_transforms_xact([stamped("foo", "bar", t, xyz) for t, xyz in legs(square)])
    for middle, (axis, sign) in zip(MIDDLES, square, strict=True):
        expected = sign * np.eye(3)[axis]
        for observer in OBSERVERS:
            velocity = tf.lookup_velocity("bar", observer, ns(T + middle), WINDOW_S)
            assert_twist(velocity, expected)
            assert (velocity.tracking_frame, velocity.observation_frame) == ("bar", observer)


def test_I02_angular_velocity(tf: Tree) -> None:
    """A frame that turns in place: the same angular velocity for every observer.
    [Q] Decision: the linear part is that of bar's own origin, which rests. tf2's, that of the
    point at the observer's origin, results from asking for that point."""
    put_offsets(tf, -1)
    turns = [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)]
    tf.set_transforms_xact([stamped("foo", "bar", t, ORIGIN, rpy(a)) for t, a in legs(turns)])
    spatial = {
        "foo": [ORIGIN] * 6,
        "child": [ORIGIN, ORIGIN, (0, 0, -1), (0, 0, 1), (0, 1, 0), (0, -1, 0)],
        "parent": [(0, -1, 0), (0, 1, 0), (1, 0, 0), (-1, 0, 0), ORIGIN, ORIGIN],
    }
    for i, (axis, sign) in enumerate(turns):
        angular = sign * np.eye(3)[axis]
        for observer in OBSERVERS:
            at = ("bar", observer, ns(T + MIDDLES[i]), WINDOW_S)
            assert_twist(tf.lookup_velocity(*at), ORIGIN, angular)
            there = tf.lookup_velocity(*at, reference_point_frame=observer)
            assert_twist(there, spatial[observer][i], angular)


def test_I03_window_longer_than_the_sampling(tf: Tree) -> None:
    """The mean over a window of four samples, its middle at the time asked for."""
    for i in range(-10, 5):
        put(tf, "PARENT", "THISFRAME", T + i, (0.3 * i, 0, 0))
    velocity = tf.lookup_velocity("THISFRAME", "PARENT", ns(T), 4.001)
    assert_twist(velocity, (0.3, 0, 0))
    assert velocity.stamp_ns == ns(T)
    assert (velocity.start_ns, velocity.end_ns) == (ns(T - 2.0005), ns(T + 2.0005))


def test_I04_velocity_at_the_latest_time(tf: Tree) -> None:
    """At the latest time the window is moved back to end there. It begins at time zero at the
    earliest; a later window that begins before the history has no answer, as in tf2."""
    for t in range(5):
        put(tf, "PARENT", "THISFRAME", t, (3 * t, 0, 0))
    velocity = tf.lookup_velocity("THISFRAME", "PARENT", None, 4.001)
    assert_twist(velocity, (3, 0, 0), tolerance=0.01)
    assert (velocity.stamp_ns, velocity.end_ns) == (ns(4), ns(4))
    shorter = tf.lookup_velocity("THISFRAME", "PARENT", None, 1.5)
    assert_twist(shorter, (3, 0, 0))
    assert (shorter.start_ns, shorter.end_ns) == (ns(2.5), ns(4))
    for t in range(5):
        put(tf, "PARENT", "THISFRAME", T + t, (3 * t, 0, 0))
    with pytest.raises(BackwardExtrapolationException) as caught:
        tf.lookup_velocity("THISFRAME", "PARENT", None, 4.001)
    assert caught.value.oldest_stamp_ns == ns(T)


def test_I05_velocity_between_two_samples(tf: Tree) -> None:
    """Reference frame and point written out: bar's own origin, in bar's axes."""
    put(tf, "foo", "bar", T - 1, ORIGIN)
    put(tf, "foo", "bar", T + 1, (2, 0, 0))
    velocity = tf.lookup_velocity(
        "bar",
        "foo",
        ns(T),
        0.1,
        reference_frame="bar",
        reference_point=ORIGIN,
        reference_point_frame="bar",
    )
    assert_twist(velocity, (1, 0, 0))
    assert velocity.reference_frame == "bar"


def test_I06_uniform_circle(tf: Tree) -> None:
    """[Q] Decision: a correct rigid-body twist, with reference frame and reference point."""
    tf.set_transforms_xact(
        [
            stamped("foo", "bar", t, (math.cos(t), math.sin(t), 0), yaw(t))
            for t in np.linspace(0, 1, 1001)
        ]
    )
    put(tf, "foo", "side", 0, (0, 3, 0), yaw(math.pi / 2), static=True)
    at, tolerance = ("bar", "foo", ns(0.5), WINDOW_S), 1e-3  # the chord is shorter than the arc
    turn = (0, 0, 1)
    tangent = np.array([-math.sin(0.5), math.cos(0.5), 0])
    assert_twist(tf.lookup_velocity(*at), tangent, turn, tolerance)
    # in other axes: bar's own, in which it always moves sideways, and a third frame's
    own = tf.lookup_velocity(*at, reference_frame="bar")
    assert_twist(own, (0, 1, 0), turn, tolerance)
    third = tf.lookup_velocity(*at, reference_frame="side")
    assert_twist(third, (tangent[1], -tangent[0], 0), turn, tolerance)
    # other points of the body: twice as far out, and at the circle's middle, three ways
    outer = tf.lookup_velocity(*at, reference_point=(1, 0, 0))
    assert_twist(outer, 2 * tangent, turn, tolerance)
    for frame, point in (("bar", (-1, 0, 0)), ("foo", ORIGIN), ("side", (-3, 0, 0))):
        middle = tf.lookup_velocity(*at, reference_point=point, reference_point_frame=frame)
        assert_twist(middle, ORIGIN, turn, tolerance)
    # seen from bar, foo turns the other way about its own origin
    assert_twist(tf.lookup_velocity("foo", "bar", ns(0.5), WINDOW_S), ORIGIN, (0, 0, -1), tolerance)
    # in its own frame nothing moves
    assert_twist(tf.lookup_velocity("bar", "bar", ns(0.5), WINDOW_S), ORIGIN)
