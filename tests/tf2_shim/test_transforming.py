"""Stamped messages into another frame, with the numbers of tf2_geometry_msgs' own tests."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

from .fake_ros.geometry_msgs import msg
from .messages import LATEST, at, lasting, link

HALF = math.sqrt(0.5)


@pytest.fixture
def buffer(shim: TransformClient) -> tf2.Buffer:
    """A -> B at 2 s: (10, 20, 30), half a turn about x."""
    buffer = tf2.Buffer()
    buffer.set_transform(link("A", "B", 2, (10.0, 20.0, 30.0), (1.0, 0.0, 0.0, 0.0)), "")
    return buffer


def stamped(message: Any, seconds: float = 2) -> Any:
    message.header.frame_id = "A"
    message.header.stamp = at(seconds).to_msg()
    return message


def pose() -> msg.Pose:
    return msg.Pose(msg.Point(1.0, 2.0, 3.0), msg.Quaternion(1.0, 0.0, 0.0, 0.0))


def covariance() -> list[float]:
    return [float(column) for _ in range(6) for column in range(1, 7)]


def xyz(point: Any) -> Any:
    assert {type(point.x), type(point.y), type(point.z)} == {float}
    return pytest.approx([point.x, point.y, point.z])


def test_point(buffer: tf2.Buffer) -> None:
    point = stamped(msg.PointStamped(point=msg.Point(1.0, 2.0, 3.0)))
    before = copy.deepcopy(point)
    got = buffer.transform(point, "B", lasting(1))
    assert type(got) is msg.PointStamped
    assert xyz(got.point) == [-9.0, 18.0, 27.0]
    assert (got.header.frame_id, got.header.stamp) == ("B", point.header.stamp)
    assert point == before  # a copy


def test_vector(buffer: tf2.Buffer) -> None:
    got = buffer.transform(stamped(msg.Vector3Stamped(vector=msg.Vector3(1.0, 2.0, 3.0))), "B")
    assert xyz(got.vector) == [1.0, -2.0, -3.0]


def test_pose(buffer: tf2.Buffer) -> None:
    got = buffer.transform(stamped(msg.PoseStamped(pose=pose())), "B")
    assert xyz(got.pose.position) == [-9.0, 18.0, 27.0]
    assert abs(got.pose.orientation.w) == pytest.approx(1.0)


def test_pose_with_covariance(buffer: tf2.Buffer) -> None:
    message = msg.PoseWithCovarianceStamped(pose=msg.PoseWithCovariance(pose(), covariance()))
    got = buffer.transform(stamped(message), "B")
    assert xyz(got.pose.pose.position) == [-9.0, 18.0, 27.0]
    outer, inner = [1, -2, -3, 4, -5, -6], [-1, 2, 3, -4, 5, 6]
    expected = [outer, inner, inner, outer, inner, inner]
    np.testing.assert_allclose(np.reshape(got.pose.covariance, (6, 6)), expected, atol=1e-9)
    assert {type(value) for value in got.pose.covariance} == {float}
    assert message.pose.covariance == covariance()


RAW: dict[str, tuple[Callable[[Any, Any], Any], Any, Callable[[Any], Any]]] = {
    "point": (
        tf2.do_transform_point,
        msg.PointStamped(point=msg.Point(1.0, 2.0, 3.0)),
        lambda out: out.point,
    ),
    "pose": (tf2.do_transform_pose, pose(), lambda out: out.position),
    "stamped pose": (
        tf2.do_transform_pose_stamped,
        msg.PoseStamped(pose=pose()),
        lambda out: out.pose.position,
    ),
    "pose with covariance": (
        tf2.do_transform_pose_with_covariance_stamped,
        msg.PoseWithCovarianceStamped(pose=msg.PoseWithCovariance(pose())),
        lambda out: out.pose.pose.position,
    ),
}


@pytest.mark.parametrize("name", RAW)
def test_functions_apply_a_transform_as_it_is(name: str) -> None:
    function, message, place = RAW[name]
    transform = link("A", "B", 2, (10.0, 20.0, 30.0), (1.0, 0.0, 0.0, 0.0))
    out = function(message, transform)
    assert xyz(place(out)) == [11.0, 18.0, 27.0]
    if hasattr(out, "header"):
        assert out.header == transform.header


def test_a_vector_is_only_turned() -> None:
    transform = link("A", "B", 2, (10.0, 20.0, 30.0), (0.0, 0.0, HALF, HALF))
    message = msg.Vector3Stamped(vector=msg.Vector3(1.0, 2.0, 3.0))
    assert xyz(tf2.do_transform_vector3(message, transform).vector) == [-2.0, 1.0, 3.0]
    assert transform.transform.translation.x == 10.0


def test_a_message_of_the_latest_time(buffer: tf2.Buffer) -> None:
    got = buffer.transform(stamped(msg.PointStamped(), 0), "B")
    assert got.header.stamp == at(2).to_msg()


def test_another_time(buffer: tf2.Buffer) -> None:
    """A point seen from B at 2 s, where it is in B at 3 s."""
    buffer.set_transform(link("A", "B", 3, (11.0, 20.0, 30.0), (1.0, 0.0, 0.0, 0.0)), "")
    point = stamped(msg.PointStamped(point=msg.Point(1.0, 0.0, 0.0)))
    point.header.frame_id = "B"
    got = buffer.transform_full(point, "B", at(3), "A", lasting(1))
    assert xyz(got.point) == [0.0, 0.0, 0.0]
    assert got.header.stamp == at(3).to_msg()


def test_errors_of_the_lookup_are_raised(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.ExtrapolationException):
        buffer.transform(stamped(msg.PointStamped(), 9), "B")


def wrench(force: Any, torque: Any) -> msg.Wrench:
    return msg.Wrench(msg.Vector3(*force), msg.Vector3(*torque))


def test_wrench() -> None:
    """Row K07 of the conformance suite; and moved back again."""
    transform = link("A", "B", 2, (0.0, -2.0, 0.0), (0.0, 0.0, -HALF, HALF))
    message = msg.WrenchStamped(wrench=wrench((2.0, 1.0, 3.0), (2.0, 1.0, 3.0)))
    out = tf2.do_transform_wrench(message, transform)
    assert xyz(out.wrench.force) == [1.0, -2.0, 3.0]
    assert xyz(out.wrench.torque) == [-5.0, -2.0, 5.0]
    assert out.header == transform.header
    assert message.wrench.force.x == 2.0


def test_a_wrench_through_the_buffer(buffer: tf2.Buffer) -> None:
    message = stamped(msg.WrenchStamped(wrench=wrench((0.0, 1.0, 0.0), (0.0, 0.0, 0.0))))
    got = buffer.transform(message, "B").wrench
    assert xyz(got.force) == [0.0, -1.0, 0.0]
    assert xyz(got.torque) == [30.0, 0.0, 10.0]  # the lever arm from B is (-10, 20, 30)


class Plane:
    """A message of a script's own."""

    def __init__(self) -> None:
        self.header = msg.Header()
        self.height = 1.0


class Floor(Plane):
    pass


def raised(plane: Any, transform: Any) -> Any:
    out = copy.deepcopy(plane)
    out.height += transform.transform.translation.z
    out.header = transform.header
    return out


def test_a_registered_type_and_its_subclasses(buffer: tf2.Buffer) -> None:
    tf2.TransformRegistration().add(Plane, raised)
    for kind in (Plane, Floor):
        plane = stamped(kind())
        got = buffer.transform(plane, "B")
        assert (type(got), got.height, got.header.frame_id) == (kind, 31.0, "B")
        assert plane.height == 1.0
        got = buffer.transform_full(plane, "B", at(2), "A")
        assert got.height == 31.0
        assert tf2.TransformRegistration().get(kind) is raised


def test_a_registered_type_comes_first(buffer: tf2.Buffer) -> None:
    class Point(msg.PointStamped):
        pass

    tf2.TransformRegistration().add(Point, lambda point, transform: "mine")
    assert buffer.transform(stamped(Point()), "B") == "mine"
    assert type(buffer.transform(stamped(msg.PointStamped()), "B")) is msg.PointStamped


def test_the_registry_names_what_it_lacks() -> None:
    registration = tf2.TransformRegistration()
    assert registration.get(msg.WrenchStamped) is tf2.do_transform_wrench
    with pytest.raises(tf2.TypeException, match="PoseArray"):
        registration.get(msg.PoseArray)


def test_other_messages_are_refused(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.TypeException, match="PoseArray"):
        buffer.transform(stamped(msg.PoseArray()), "B")


def test_a_result_fills_a_message(buffer: tf2.Buffer) -> None:
    result = buffer.lookup_transform("A", "B", LATEST)
    message = tf2.fill(msg.TransformStamped(), result)
    assert type(message) is msg.TransformStamped
    assert message == link("A", "B", 2, (10.0, 20.0, 30.0), (1.0, 0.0, 0.0, 0.0))
    assert type(message.header) is msg.Header
