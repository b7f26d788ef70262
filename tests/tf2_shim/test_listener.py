"""Broadcasters and listeners without a server: on the process's topics, and on those of nodes, for
which stand-ins of rclpy's shape are here; none of these tests runs ROS 2."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable
from typing import Any

import pytest
from rclpy import executors, topics
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

from tests.support.waiting import wait_until
from zenoh_tf import tf2
from zenoh_tf.tf2 import topics as own_topics

from .messages import LATEST, at, lasting, link


class OnlyNamed:
    def get_name(self) -> str:
        return "short"


@pytest.fixture(params=["no node", "a name", "a node"])
def node(request: pytest.FixtureRequest, process_topics: None) -> Any:
    """What broadcasters and listeners are made with."""
    topics._subscriptions.clear()
    topics._publishers.clear()
    return {"no node": None, "a name": OnlyNamed(), "a node": Node("robot")}[request.param]


def test_a_listener_fills_its_buffer(node: Any) -> None:
    filled, other = tf2.Buffer(), tf2.Buffer()
    listener = tf2.TransformListener(filled, node)
    assert (listener.buffer, listener.node) == (filled, node)
    sender = tf2.TransformBroadcaster(node)
    sender.sendTransform(link("map", "odom", 1, (1.0, 2.0, 3.0)))
    sender.sendTransform([link("map", "odom", 2), link("odom", "base", 2)])
    sender.sendTransform([])
    assert filled.can_transform("map", "base", at(2), lasting(30))
    got = filled.lookup_transform("map", "odom", at(1)).transform.translation
    assert got == tf2.Vector3(1.0, 2.0, 3.0)
    assert 'broadcaster: "default_authority"' in filled.all_frames_as_yaml()
    assert other.all_frames_as_string() == ""


def test_a_late_listener_gets_all_static_transforms(node: Any) -> None:
    sender = tf2.StaticTransformBroadcaster(node)
    sender.sendTransform(link("base", "camera", 0, (1.0, 0.0, 0.0)))
    sender.sendTransform([link("base", "lidar", 0), link("lidar", "spot", 0)])
    sender.sendTransform(link("base", "camera", 0, (2.0, 0.0, 0.0)))
    for kind in (tf2.TransformListener, tf2.StaticTransformListener):
        buffer = tf2.Buffer()
        kind(buffer, node)
        assert buffer.can_transform("camera", "spot", at(5), lasting(30))
        assert buffer.lookup_transform("base", "camera", LATEST).transform.translation.x == 2.0


def test_a_listener_of_static_transforms_only(node: Any) -> None:
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, node, static_only=True)
    tf2.TransformBroadcaster(node).sendTransform(link("map", "base", 1))
    tf2.StaticTransformBroadcaster(node).sendTransform(link("base", "camera", 1))
    assert buffer.can_transform("base", "camera", at(3), lasting(30))
    assert buffer.all_frames_as_string() == "Frame camera exists with parent base.\n"


def test_an_unregistered_listener_is_deaf(node: Any) -> None:
    first, second = tf2.Buffer(), tf2.Buffer()
    listener = tf2.TransformListener(first, node)
    tf2.TransformListener(second, node)
    listener.unregister()
    listener.unregister()
    tf2.TransformBroadcaster(node).sendTransform(link("map", "base", 1))
    assert second.can_transform("map", "base", at(1), lasting(30))
    assert first.all_frames_as_string() == ""


def test_what_a_buffer_rejects_is_logged(node: Any, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, node)
    tf2.TransformBroadcaster(node).sendTransform([link("a", "a", 1), link("map", "base", 1)])
    assert buffer.can_transform("map", "base", at(1), lasting(30))
    assert [record.name for record in caplog.records] == ["zenoh_tf.tf2"]
    assert "rejected" in caplog.text


def test_a_sent_message_may_be_used_again(node: Any) -> None:
    """As the tutorials do it: one message, changed and sent again."""
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, node)
    sender, message = tf2.TransformBroadcaster(node), link("map", "base", 1)
    for seconds in (1, 2):
        message.header.stamp = at(seconds).to_msg()
        message.transform.translation.x = float(seconds)
        sender.sendTransform(message)
    assert buffer.can_transform("map", "base", at(2), lasting(30))
    assert buffer.lookup_transform("map", "base", at(1)).transform.translation.x == 1.0


def test_a_buffer_of_a_script_is_filled(node: Any) -> None:
    class Mine(tf2.BufferInterface):
        def __init__(self) -> None:
            super().__init__()
            self.stored: list[tuple[str, str]] = []

        def set_transform(self, transform: Any, authority: str) -> None:
            self.stored.append((transform.child_frame_id, authority))

        set_transform_static = set_transform

    mine = Mine()
    tf2.TransformListener(mine, node)
    tf2.TransformBroadcaster(node).sendTransform(link("map", "base", 1))
    wait_until(lambda: mine.stored == [("base", "default_authority")])


def test_a_buffer_that_is_gone_is_not_filled(process_topics: None) -> None:
    before = len(own_topics._subscribers)
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer)
    assert len(own_topics._subscribers) == before + 2
    del buffer
    gc.collect()
    assert len(own_topics._subscribers) == before


def test_other_topics(node: Any) -> None:
    """They are other topics, as in tf2: the broadcasters' are /tf and /tf_static."""
    buffer, usual = tf2.Buffer(), tf2.Buffer()
    tf2.TransformListener(buffer, node, tf_topic="/robot/tf", tf_static_topic="/robot/tf_static")
    tf2.TransformListener(usual, node, tf_topic="/tf", tf_static_topic="/tf_static")
    tf2.TransformBroadcaster(node).sendTransform(link("map", "base", 1))
    assert usual.can_transform("map", "base", at(1), lasting(30))
    assert buffer.all_frames_as_string() == ""


def test_the_qualities_of_service_are_tf2s() -> None:
    topics._subscriptions.clear()
    topics._publishers.clear()
    node = Node("robot")
    tf2.TransformListener(tf2.Buffer(), node)
    tf2.TransformBroadcaster(node)
    tf2.StaticTransformBroadcaster(node)
    for made, static_depth in ((topics._subscriptions, 100), (topics._publishers, 1)):
        assert {each.topic: (each.qos.depth, each.qos.durability) for each in made} == {
            "/tf": (100, DurabilityPolicy.VOLATILE),
            "/tf_static": (static_depth, DurabilityPolicy.TRANSIENT_LOCAL),
        }
    tf2.TransformListener(tf2.Buffer(), node, qos=5, static_qos=6)
    assert [each.qos for each in topics._subscriptions[2:]] == [5, 6]
    assert tf2.TransformBroadcaster(node, 7) and topics._publishers[-1].qos == 7


def test_a_thread_may_spin_the_node() -> None:
    node = Node("robot")
    listener = tf2.TransformListener(tf2.Buffer(), node, spin_thread=True)
    wait_until(lambda: executors.spinning == [node])
    listener.unregister()
    wait_until(lambda: executors.spinning == [])


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: tf2.TransformListener(Node("robot"), tf2.Buffer()), "buffer"),
        (lambda: tf2.TransformListener(Node("robot")), "buffer"),
        (lambda: tf2.TransformListener(tf2.Buffer(), "robot"), "node"),
        (lambda: tf2.TransformListener(tf2.BufferInterface(), "robot"), "node"),
        (lambda: tf2.TransformBroadcaster("robot"), "node"),
        (lambda: tf2.StaticTransformBroadcaster(tf2.Buffer()), "node"),
    ],
)
def test_what_is_no_buffer_or_node_is_refused(make: Callable[[], object], field: str) -> None:
    with pytest.raises(
        tf2.InvalidArgumentException, match=f"^{field} must be a .*, not "
    ) as refusal:
        make()
    assert refusal.value.field == field
