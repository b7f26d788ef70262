"""`Time` and `Duration`: made as in builtin_interfaces and as in rclpy."""

from __future__ import annotations

import copy

import pytest

from zenoh_tf_client import tf2

from .fake_ros.builtin_interfaces import msg
from .fake_ros.rclpy.duration import Duration
from .fake_ros.rclpy.time import Time


@pytest.mark.parametrize("kind", [tf2.Time, tf2.Duration])
def test_every_way_to_make_one(kind: type[tf2.Time] | type[tf2.Duration]) -> None:
    expected = kind(1, 500_000_000)
    assert (expected.sec, expected.nanosec, expected.nanoseconds) == (1, 500_000_000, 15 * 10**8)
    assert kind(seconds=1.5) == expected
    assert kind(nanoseconds=1_500_000_000) == expected
    assert kind(seconds=1, nanoseconds=500_000_000) == expected
    assert kind(sec=1, nanosec=500_000_000) == expected
    assert kind() == kind(0, 0)
    assert kind.from_msg(msg.Time(1, 500_000_000)) == expected
    assert kind.from_msg(Time(seconds=1.5)) == expected
    assert expected.to_msg() == expected
    assert expected.to_msg() is not expected
    assert copy.deepcopy(expected) == expected
    assert repr(expected) == f"{kind.__name__}(sec=1, nanosec=500000000)"


def test_nanoseconds_are_exact() -> None:
    now_ns = 1_763_870_400_123_456_789
    assert tf2.Time(nanoseconds=now_ns).nanoseconds == now_ns
    assert tf2.Time(nanoseconds=now_ns).seconds_nanoseconds() == (1_763_870_400, 123_456_789)


def test_a_negative_one_has_positive_nanoseconds_as_messages_do() -> None:
    assert tf2.Duration(seconds=-0.25) == tf2.Duration(-1, 750_000_000)


def test_times_are_fields_of_messages() -> None:
    """A plain assignment of the fields, as scripts do it."""
    time = tf2.Time()
    time.sec, time.nanosec = 3, 4
    assert time.nanoseconds == 3_000_000_004


@pytest.mark.parametrize("time", [tf2.Time(2), Time(seconds=2), msg.Time(2, 0)])
def test_the_difference_of_times_is_a_duration(time: object) -> None:
    difference = tf2.Time(seconds=5) - time
    assert type(difference) is tf2.Duration
    assert difference == tf2.Duration(seconds=3)


@pytest.mark.parametrize("duration", [tf2.Duration(2), Duration(seconds=2), msg.Duration(2, 0)])
def test_a_duration_moves_a_time(duration: object) -> None:
    before, after = tf2.Time(seconds=5) - duration, tf2.Time(seconds=5) + duration
    assert (before, after) == (tf2.Time(3), tf2.Time(7))
    assert before < tf2.Time(5) < after


def test_a_time_is_no_duration() -> None:
    duration: object = tf2.Duration(1)
    assert tf2.Time(1) != duration
    with pytest.raises(TypeError, match="neither a time nor a duration"):
        tf2.Time(1) + 1.5
