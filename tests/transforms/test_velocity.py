"""Velocities of one frame in another, for motions whose twist is known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

from tests.support.runs import CONTROLS
from zenoh_tf import StampedTransform, Transform, TransformTree, Velocity
from zenoh_tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    LookupException,
    TransformException,
)

S = 1_000_000_000

Vector = tuple[float, float, float]


def turned(axis: str, angle: float, translation: Vector = (0.0, 0.0, 0.0)) -> Transform:
    rotation = np.zeros(4)
    rotation["xyz".index(axis)] = np.sin(angle / 2)
    rotation[3] = np.cos(angle / 2)
    return Transform(translation, rotation)


def move(
    tf: TransformTree,
    parent: str,
    child: str,
    pose: Callable[[float], Transform],
    seconds: float = 1.0,
) -> None:
    """Samples of a motion from 0 s on, every 10 ms."""
    tf.set_transforms_xact(
        [
            StampedTransform(parent, child, i * S // 100, pose(i / 100))
            for i in range(round(seconds * 100) + 1)
        ]
    )


def circle(t: float) -> Transform:
    """Radius 1 m, 1 rad/s, looking outward."""
    return turned("z", t, (np.cos(t), np.sin(t), 0.0))


@pytest.fixture(params=CONTROLS)
def tree(request: pytest.FixtureRequest) -> TransformTree:
    concurrency: Literal["optimistic", "2pl", "giant"] = request.param
    return TransformTree(concurrency=concurrency)


def check(velocity: Velocity, linear: Any, angular: Any) -> None:
    np.testing.assert_allclose(velocity.linear, linear, atol=1e-12)
    np.testing.assert_allclose(velocity.angular, angular, atol=1e-12)


def test_a_point_off_the_axis(tree: TransformTree) -> None:
    move(tree, "map", "disk", lambda t: turned("z", 2 * t, (5.0, 0.0, 0.0)))
    rim = tree.lookup_velocity("disk", "map", S // 2, reference_point=(0.5, 0, 0.3))
    check(rim, np.cross((0, 0, 2), (0.5 * np.cos(1), 0.5 * np.sin(1), 0)), (0, 0, 2))
    # the same point of the body, given in the observer's frame and in a third one
    tree.set_transform(StampedTransform("map", "post", 0, Transform((5.0, 1.0, 0.0))), static=True)
    for frame, point in [("map", (5.0, 2.0, 0.0)), ("post", (0.0, 1.0, 0.0))]:
        outside = tree.lookup_velocity(
            "disk", "map", S // 2, reference_point=point, reference_point_frame=frame
        )
        check(outside, (-4, 0, 0), (0, 0, 2))
    # the observer's own origin: the spatial twist that tf2 reports
    spatial = tree.lookup_velocity("disk", "map", S // 2, reference_point_frame="map")
    check(spatial, np.cross((0, 0, 2), (-5, 0, 0)), (0, 0, 2))


def test_a_screw_motion(tree: TransformTree) -> None:
    """About a moving axis that does not go through any origin, forward along it."""
    pitch = 0.25
    move(tree, "map", "nut", lambda t: turned("x", 3 * t, (pitch * t, 0.0, 0.0)))
    check(tree.lookup_velocity("nut", "map", S // 2), (pitch, 0, 0), (3, 0, 0))
    for radius in (0.1, 2.0):
        on_thread = tree.lookup_velocity(
            "nut", "map", S // 2, reference_point=(7, radius, 0), reference_frame="nut"
        )
        check(on_thread, (pitch, 0, 3 * radius), (3, 0, 0))


def test_moving_reference_and_observation_frames(tree: TransformTree) -> None:
    move(tree, "map", "train", lambda t: turned("z", 0.5 * t, (20 * t, 0.0, 0.0)))
    move(tree, "train", "cart", lambda t: Transform((0.0, 1.5 * t, 0.0)))
    move(tree, "map", "eye", lambda t: turned("y", 4 * t))
    # seen from the train, however it moves; in the axes that other frames have at that time
    check(tree.lookup_velocity("cart", "train", S // 2), (0, 1.5, 0), (0, 0, 0))
    in_map = tree.lookup_velocity("cart", "train", S // 2, reference_frame="map")
    check(in_map, (-1.5 * np.sin(0.25), 1.5 * np.cos(0.25), 0), (0, 0, 0))
    seen = tree.lookup_velocity("train", "map", S // 2, reference_frame="eye").angular
    np.testing.assert_allclose(seen, 0.5 * np.array([-np.sin(2), 0, np.cos(2)]), atol=1e-12)
    # angular velocities add, in common axes
    seen = tree.lookup_velocity("train", "eye", S // 2, reference_frame="map").angular
    np.testing.assert_allclose(seen, (0, -4, 0.5), atol=0.02)  # the mean of a turning axis


def test_the_window(tree: TransformTree) -> None:
    move(tree, "map", "car", lambda t: Transform((t * t, 0.0, 0.0)))
    tree.set_transform(StampedTransform("car", "seat", 0, Transform((0.0, 1.0, 0.0))), static=True)

    def window(*question: Any) -> tuple[float, float, float, float]:
        v = tree.lookup_velocity("seat", "map", *question)
        return v.stamp_ns / S, v.start_ns / S, v.end_ns / S, v.linear[0]

    assert window(S // 2) == pytest.approx((0.5, 0.45, 0.55, 1.0))
    assert window(S // 2, 0.2) == pytest.approx((0.5, 0.4, 0.6, 1.0))
    # moved back at the latest common time, which None means
    assert window(98 * S // 100) == pytest.approx((0.98, 0.9, 1.0, 1.9))
    assert window() == pytest.approx((1.0, 0.9, 1.0, 1.9))
    # cut off at time zero
    assert window(S // 100) == pytest.approx((0.01, 0.0, 0.06, 0.06))
    # without a pose at the time itself there is no velocity
    with pytest.raises(ForwardExtrapolationException) as forward:
        window(S + 1)
    assert forward.value.stamp_ns == S + 1


def test_what_does_not_move(tree: TransformTree) -> None:
    tree.set_transform(StampedTransform("map", "post", 0, circle(1.0)), static=True)
    still = tree.lookup_velocity("post", "map", reference_point=(1, 2, 3))
    check(still, (0, 0, 0), (0, 0, 0))
    assert still.stamp_ns == 0
    check(tree.lookup_velocity("map", "post", -(1 << 63) + 1), (0, 0, 0), (0, 0, 0))
    check(tree.lookup_velocity("map", "map", (1 << 63) - 1), (0, 0, 0), (0, 0, 0))
    assert tree.lookup_velocity("map", "post", 7 * S).stamp_ns == 7 * S


@pytest.mark.parametrize("angle", [1e-12, 1e-9, 1e-5, 1.9e-3, 2.1e-3, 0.5, 3.0, -3.0])
def test_angles_small_and_large(tree: TransformTree, angle: float) -> None:
    """Also where the two orientations' quaternions are of opposite signs."""
    for sign in (1.0, -1.0):
        poses = [turned("y", 0.2), turned("y", 0.2 + angle)]
        poses[1] = Transform(rotation=sign * poses[1].rotation)
        for stamp, pose in zip((0, S // 10), poses, strict=True):
            tree.set_transform(StampedTransform("map", "top", stamp, pose))
        rate = tree.lookup_velocity("top", "map").angular
        np.testing.assert_allclose(rate, (0, 10 * angle, 0), rtol=1e-9, atol=1e-14)


def test_a_velocity_cannot_be_changed(tree: TransformTree) -> None:
    move(tree, "map", "car", circle)
    velocity = tree.lookup_velocity("car", "map")
    with pytest.raises(ValueError, match="read-only"):
        velocity.linear[0] = 1.0
    with pytest.raises(AttributeError):
        velocity.stamp_ns = 1  # type: ignore[misc]


def fill(tf: TransformTree) -> None:
    move(tf, "map", "car", circle)
    move(tf, "car", "wheel", lambda t: turned("y", 5 * t, (0.0, 1.0, 0.0)), seconds=0.8)
    move(tf, "map", "late", lambda t: turned("x", t), seconds=0.3)
    tf.set_transform(StampedTransform("island", "shore", S, Transform()))


THEN = ("car", "map", S // 2)
#: What is asked, the error, and its target and source.
ERRORS: list[tuple[Any, dict[str, Any], type[TransformException], tuple[str, ...]]] = [
    (("nowhere", "map"), {}, LookupException, ("map", "nowhere")),
    (("shore", "map"), {}, ConnectivityException, ("map", "shore")),
    (("shore", "island"), {}, ExtrapolationException, ("island", "shore")),
    (("wheel", "map", 9 * S // 10), {}, ForwardExtrapolationException, ("map", "wheel")),
    (THEN, {"reference_frame": "late"}, ForwardExtrapolationException, ("late", "map")),
    (THEN, {"reference_frame": "island"}, ConnectivityException, ("island", "map")),
    (THEN, {"reference_frame": "nowhere"}, LookupException, ("nowhere", "map")),
    (THEN, {"reference_point_frame": "late"}, ForwardExtrapolationException, ("map", "late")),
]


@pytest.mark.parametrize(("asked", "options", "kind", "expected"), ERRORS)
def test_errors_name_what_failed(
    tree: TransformTree, asked: Any, options: Any, kind: Any, expected: Any
) -> None:
    fill(tree)
    with pytest.raises(kind) as caught:
        tree.lookup_velocity(*asked, **options)
    error = caught.value
    assert (error.target_frame, error.source_frame) == expected
