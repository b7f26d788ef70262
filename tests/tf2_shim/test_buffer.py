"""`Buffer` with a tree of its own, and at a real server: tf2_ros's calls, results, exceptions."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from ruamel.yaml import YAML

from zenoh_tf import LimitExceeded, tf2

from .messages import LATEST, at, lasting, link


@pytest.fixture
def buffer(make_buffer: Callable[..., tf2.Buffer]) -> tf2.Buffer:
    """map -> base with x = 10 t at 1, 2 and 3 s, base -> camera static."""
    buffer = make_buffer(cache_time=lasting(10))
    for seconds in (1, 2, 3):
        buffer.set_transform(link("map", "base", seconds, (10.0 * seconds, 0.0, 0.0)), "wheels")
    buffer.set_transform_static(link("base", "camera", 0, (0.0, 0.0, 0.5)), "urdf")
    return buffer


def test_a_lookup_is_a_transform_stamped(buffer: tf2.Buffer) -> None:
    got = buffer.lookup_transform("map", "camera", at(1.5))
    assert got == tf2.TransformStamped(
        tf2.Header(tf2.Time(1, 500_000_000), "map"),
        "camera",
        tf2.Transform(tf2.Vector3(15.0, 0.0, 0.5), tf2.Quaternion(0.0, 0.0, 0.0, 1.0)),
    )
    assert type(got.transform.translation.x) is float  # ROS's messages accept nothing else


@pytest.mark.parametrize(
    "time",
    [
        at(1.5),
        at(1.5).to_msg(),
        tf2.Time(1, 500_000_000),
        SimpleNamespace(secs=1, nsecs=500_000_000),
        1.5,
    ],
    ids=["rclpy", "builtin_interfaces", "own", "ROS 1", "seconds"],
)
def test_times_of_every_kind(buffer: tf2.Buffer, time: Any) -> None:
    assert buffer.lookup_transform("map", "base", time).transform.translation.x == 15.0
    assert buffer.lookup_transform("map", "base", time, time).transform.translation.x == 15.0


def test_time_zero_is_the_latest_common_time(buffer: tf2.Buffer) -> None:
    got = buffer.lookup_transform("base", "map", LATEST)
    assert got.header.stamp == tf2.Time(3, 0)
    assert got.transform.translation.x == -30.0
    assert buffer.get_latest_common_time("camera", "map") == tf2.Time(3, 0)
    assert buffer.get_latest_common_time("camera", "map").nanoseconds == 3_000_000_000
    assert buffer.lookup_transform("base", "camera", LATEST).header.stamp == tf2.Time(0, 0)
    assert buffer.get_latest_common_time("base", "camera") == tf2.Time(0, 0)


@pytest.mark.parametrize("time", [None, True, "now"])
def test_what_is_no_time(buffer: tf2.Buffer, time: Any) -> None:
    with pytest.raises(TypeError, match="neither a time nor a duration"):
        buffer.lookup_transform("map", "base", time)


REFUSED = [
    (("map", "nowhere", LATEST), tf2.LookupException, "nowhere"),
    (("map", "island", LATEST), tf2.ConnectivityException, "island"),
    (("map", "base", at(3.5)), tf2.ExtrapolationException, "extrapolation into the future"),
    (("map", "base", at(0.5)), tf2.ExtrapolationException, "extrapolation into the past"),
    (("/map", "base", LATEST), tf2.InvalidArgumentException, "/map"),
    (("", "base", LATEST), tf2.InvalidArgumentException, "empty"),
]


@pytest.mark.parametrize(("question", "kind", "text"), REFUSED)
def test_exceptions(buffer: tf2.Buffer, question: Any, kind: Any, text: str) -> None:
    buffer.set_transform(link("sea", "island", 1), "")
    with pytest.raises(kind, match=text) as caught:
        buffer.lookup_transform(*question)
    assert isinstance(caught.value, tf2.TransformException)
    assert buffer.can_transform(*question) is False
    possible, why = buffer.can_transform(*question, return_debug_tuple=True)  # type: ignore[misc]
    assert possible is False
    assert text in why
    target, source, time = question
    assert buffer.can_transform_full(target, time, source, time, "map") is False


def test_can_transform(buffer: tf2.Buffer) -> None:
    assert buffer.can_transform("map", "camera", at(2.5)) is True
    assert buffer.can_transform("map", "camera", at(2.5), lasting(1), True) == (True, "")


def test_a_negative_time_out_is_none(buffer: tf2.Buffer) -> None:
    assert buffer.can_transform("map", "nowhere", LATEST, lasting(-1)) is False


def test_errors_name_the_shims_time_out(buffer: tf2.Buffer) -> None:
    lookups: tuple[tuple[Any, tuple[Any, ...]], ...] = (
        (buffer.lookup_transform, ("map", "base", at(3.5))),
        (buffer.lookup_transform_full, ("map", at(3.5), "base", at(3.5), "map")),
    )
    for look_up, question in lookups:
        with pytest.raises(tf2.ExtrapolationException, match="give the lookup a time-out to wait"):
            look_up(*question)
        with pytest.raises(tf2.InvalidArgumentException, match=r"^timeout must be ") as refusal:
            look_up(*question, float("nan"))
        assert refusal.value.field == "timeout"
    with pytest.raises(tf2.LookupException, match="frame 'a timeout_s' does not exist"):
        buffer.lookup_transform("map", "a timeout_s", LATEST)


@pytest.mark.usefixtures("shim")
@pytest.mark.parametrize("timeout_s", [601, 3601])
def test_a_time_out_that_the_server_refuses(timeout_s: int) -> None:
    refused = (LimitExceeded, tf2.InvalidArgumentException)
    with pytest.raises(refused, match=f"^(?!.*timeout_s).*{timeout_s}") as refusal:
        tf2.Buffer().lookup_transform("map", "base", LATEST, timeout_s)
    assert refusal.value.field == "timeout"


def test_travel_in_time(buffer: tf2.Buffer) -> None:
    """Where the base was at 1 s, seen from where it is at 3 s."""
    question = ("base", at(3), "base", at(1), "map")
    got = buffer.lookup_transform_full(*question, timeout=lasting(1))
    assert got.transform.translation.x == -20.0
    assert got.header.stamp == tf2.Time(3, 0)
    assert (got.header.frame_id, got.child_frame_id) == ("base", "base")
    assert buffer.can_transform_full(*question) is True
    assert buffer.can_transform_full(*question, return_debug_tuple=True) == (True, "")
    newest = buffer.lookup_transform_full("map", LATEST, "base", LATEST, "map")
    assert newest.transform.translation.x == 30.0


def test_sets_say_what_is_wrong(buffer: tf2.Buffer) -> None:
    assert buffer.set_transform(link("map", "base", 4, (40.0, 0.0, 0.0)), "wheels") is None  # type: ignore[func-returns-value]
    assert buffer.lookup_transform("map", "base", at(4)).transform.translation.x == 40.0
    buffer.set_transform(link("map", "base", 100), "wheels")
    buffer.set_transform(link("map", "base", 5), "wheels")  # too old: dropped, as in tf2
    assert not buffer.can_transform("map", "base", at(5))
    with pytest.raises(tf2.InvalidArgumentException, match="map"):
        buffer.set_transform(link("map", "map", 1), "wheels")
    with pytest.raises(tf2.InvalidArgumentException):
        buffer.set_transform_static(link("map", "x", 1, turn=(0.0, 0.0, 0.0, 2.0)), "urdf")


def test_clear_keeps_what_is_static(buffer: tf2.Buffer) -> None:
    buffer.clear()
    assert buffer.can_transform("base", "camera", at(7))
    with pytest.raises(tf2.ConnectivityException):
        buffer.lookup_transform("map", "base", LATEST)


def test_frames_as_text(buffer: tf2.Buffer) -> None:
    assert sorted(buffer.all_frames_as_string().splitlines()) == [
        "Frame base exists with parent map.",
        "Frame camera exists with parent base.",
    ]


def test_frames_as_yaml(make_buffer: Callable[..., tf2.Buffer]) -> None:
    buffer = make_buffer()
    assert buffer.all_frames_as_yaml() == "[]"
    buffer.set_transform(link("foo", "bar", 10), "me")
    buffer.set_transform(link("foo", "bar", 11), "me")
    buffer.set_transform(link("foo", "bar", 12), "you")
    buffer.set_transform_static(link("foo", 'a: "b"\n', 5), "urdf")
    assert YAML(typ="safe").load(buffer.all_frames_as_yaml()) == {
        "bar": {
            "parent": "foo",
            "broadcaster": "you",
            "rate": 1.5,
            "most_recent_transform": 12.0,
            "oldest_transform": 10.0,
            "buffer_length": 2.0,
        },
        'a: "b"\n': {
            "parent": "foo",
            "broadcaster": "urdf",
            "rate": 10000.0,
            "most_recent_transform": 0.0,
            "oldest_transform": 0.0,
            "buffer_length": 0.0,
        },
    }


def test_what_has_a_wrong_type_is_named(buffer: tf2.Buffer) -> None:
    wrong: Any = None  # for fields that are declared
    number: Any = 1.5
    late, point = tf2.Header(wrong, "map"), tf2.PointStamped
    unnamed = tf2.Header(at(1).to_msg(), wrong)
    calls: list[tuple[Callable[..., Any], tuple[Any, ...], str]] = [
        (buffer.lookup_transform, ("map", "base", None), "time"),
        (buffer.can_transform, ("map", "base", None), "time"),
        (buffer.can_transform, (None, "base", LATEST), "target_frame"),
        (buffer.can_transform_full, ("map", at(1), "base", at(1), 3), "fixed_frame"),
        (buffer.lookup_transform_full, ("map", at(1), "base", "now", "map"), "source_time"),
        (buffer.lookup_transform, ("map", "base", LATEST, "long"), "timeout"),
        (buffer.set_transform, (tf2.TransformStamped(late, "base"), ""), "header.stamp"),
        (buffer.set_transform, (tf2.TransformStamped(tf2.Header(number, "a")), ""), "header.stamp"),
        (buffer.set_transform_static, (tf2.TransformStamped(unnamed, "b"), ""), "header.frame_id"),
        (buffer.set_transform, (tf2.TransformStamped(child_frame_id=wrong), ""), "child_frame_id"),
        (buffer.set_transform, (tf2.TransformStamped(transform=wrong), ""), "transform"),
        (buffer.set_transform, (object(), ""), "header.frame_id"),
        (tf2.TransformBroadcaster().sendTransform, (tf2.Transform(),), "header.frame_id"),
        (buffer.transform, (object(), "map"), "header.frame_id"),
        (buffer.transform, (point(unnamed), "map"), "header.frame_id"),
        (buffer.transform_full, (point(late), "map", at(1), "map"), "header.stamp"),
    ]
    for call, arguments, field in calls:
        with pytest.raises(tf2.InvalidArgumentException, match=field) as refusal:
            call(*arguments)
        assert refusal.value.field == field
        assert isinstance(refusal.value, TypeError)  # as Python's own, which they were
