"""Broadcasters and the listener against a real server."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.waiting import wait_until
from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

from .fake_ros.rclpy.node import Node
from .messages import LATEST, at, lasting, link


class OnlyNamed:
    def get_name(self) -> str:
        return "short"


def test_one_transform_or_several(shim: TransformClient) -> None:
    broadcaster = tf2.TransformBroadcaster(Node("wheels", "/robot"), 10)
    broadcaster.sendTransform(link("map", "odom", 1))
    broadcaster.sendTransform([link("map", "odom", 2), link("odom", "base", 2)])
    broadcaster.sendTransform(tuple(link("odom", "base", seconds) for seconds in (3, 4)))
    broadcaster.sendTransform([])
    assert tf2.Buffer().can_transform("map", "base", at(2), lasting(30))
    wait_until(lambda: shim.frame("base").samples == 3)
    assert shim.frame("odom").samples == 2


@pytest.mark.parametrize(
    ("node", "authority"),
    [(Node("wheels", "/robot"), "/robot/wheels"), (OnlyNamed(), "short"), (None, "tf2")],
)
def test_a_node_lends_its_name(shim: TransformClient, node: Any, authority: str) -> None:
    tf2.TransformBroadcaster(node).sendTransform(link("map", "base", 1))
    tf2.StaticTransformBroadcaster(node).sendTransform(link("base", "camera", 1))
    assert tf2.Buffer().can_transform("map", "camera", at(1), lasting(30))
    assert shim.frame("base").authority == shim.frame("camera").authority == authority
    assert not shim.frame("base").static
    assert shim.frame("camera").static


def test_results_can_be_sent(shim: TransformClient) -> None:
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1, (1.0, 2.0, 3.0)), "")
    got = buffer.lookup_transform("map", "base", LATEST)
    got.child_frame_id = "copy"
    tf2.TransformBroadcaster().sendTransform(got)
    assert buffer.can_transform("copy", "base", at(1), lasting(30))
    assert buffer.lookup_transform("copy", "base", at(1)).transform == tf2.Transform()


def test_a_static_broadcaster_tells_a_late_server_every_child(
    start_server: Any,
) -> None:
    """Children of several calls, and of one that was sent twice the later."""
    server = start_server()
    tf2.connect(server.endpoint)
    broadcaster = tf2.StaticTransformBroadcaster(Node("urdf"))
    broadcaster.sendTransform(link("base", "camera", 0, (1.0, 0.0, 0.0)))
    broadcaster.sendTransform([link("base", "lidar", 0), link("lidar", "spot", 0)])
    broadcaster.sendTransform(link("base", "camera", 0, (2.0, 0.0, 0.0)))
    buffer = tf2.Buffer()
    assert buffer.can_transform("camera", "spot", LATEST, lasting(30))
    server.stop()
    start_server(endpoint=server.endpoint)
    wait_until(lambda: _answers(buffer))
    assert buffer.lookup_transform("base", "camera", LATEST).transform.translation.x == 2.0
    tf2.close()


def _answers(buffer: tf2.Buffer) -> bool | tuple[bool, str]:
    try:
        return buffer.can_transform("camera", "spot", LATEST)
    except tf2.TransformException:
        return False  # no server yet


def test_a_listener_has_nothing_to_do(shim: TransformClient) -> None:
    """Transforms arrive without a listener."""
    shim_buffer = tf2.Buffer()
    node = Node("listener")
    tf2.TransformBroadcaster().sendTransform(link("map", "base", 1))
    listener = tf2.TransformListener(shim_buffer, node, spin_thread=True, qos=1, static_qos=1)
    assert (listener.buffer, listener.node) == (shim_buffer, node)
    assert shim_buffer.can_transform("map", "base", at(1), lasting(30))
    listener.unregister()
    assert shim_buffer.can_transform("map", "base", at(1))
