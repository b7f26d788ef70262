"""Which server a script talks to, and what happens if there is none."""

from __future__ import annotations

from typing import Any

import pytest

from zenoh_tf.errors import ServerUnavailable
from zenoh_tf_client import TransformClient, tf2
from zenoh_tf_client.tf2 import connection

from .messages import LATEST, at, link


@pytest.fixture(autouse=True)
def _closed() -> Any:
    yield
    tf2.close()


def test_the_environment_names_the_server(
    start_server: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = start_server(tree="robot 1")
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    monkeypatch.setenv("ZENOH_TF_TREE", "robot 1")
    tf2.Buffer().set_transform(link("map", "base", 1), "")
    with server.connect() as tf:
        assert tf.can_transform("map", "base")
    assert tf2.connect() is tf2.connect(server.endpoint) is tf2.connect(tree="robot 1")


def test_a_script_names_the_server(start_server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which counts more than the environment."""
    monkeypatch.setenv("ZENOH_TF_CONNECT", "tcp/127.0.0.1:1")
    monkeypatch.setenv("ZENOH_TF_TREE", "other")
    server = start_server(tree="mine")
    tf = tf2.connect(server.endpoint, "mine")
    tf2.Buffer().set_transform(link("map", "base", 1), "")
    assert tf.can_transform("map", "base")


def test_the_shim_leaves_the_defaults_to_the_sdk(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    class Recorder:
        @classmethod
        def connect(cls, endpoint: str | None, tree: str | None) -> Recorder:
            asked.append((endpoint, tree))
            return cls()

        def close(self) -> None:
            pass

    monkeypatch.setattr(connection, "TransformClient", Recorder)
    tf2.connect()
    assert asked == [(None, None)]


@pytest.mark.parametrize("tree", ["main", "mine"])
def test_the_sdk_obeys_the_environment(
    start_server: Any, monkeypatch: pytest.MonkeyPatch, tree: str
) -> None:
    server = start_server(tree=tree)
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    monkeypatch.setenv("ZENOH_TF_TREE", tree)
    monkeypatch.setenv("ZENOH_TF_READS", "query")
    with TransformClient.connect() as tf:
        assert (tf.endpoint, tf.tree_name, tf.reads) == (server.endpoint, tree, "query")
    with TransformClient.connect(reads="shared") as tf:  # an argument counts more
        assert tf.tree_name == tree


def test_one_server_at_a_time(start_server: Any) -> None:
    first, second = start_server(), start_server()
    tf2.connect(first.endpoint)
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1), "")
    with pytest.raises(tf2.InvalidArgumentException, match=r"close\(\) that connection first"):
        tf2.connect(second.endpoint)
    with pytest.raises(tf2.InvalidArgumentException):
        tf2.connect(tree="other")
    tf2.close()
    tf2.close()
    tf2.connect(second.endpoint)
    assert not buffer.can_transform("map", "base", at(1))  # buffers follow


def test_without_a_server(start_server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A buffer can be made; a script that catches tf2's exceptions and tries again gets along."""
    server = start_server()
    server.stop()
    monkeypatch.setenv("ZENOH_TF_CONNECT", server.endpoint)
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer)
    waiting = buffer.wait_for_transform_async("map", "base", LATEST)
    assert not waiting.done()  # the caller may be an event loop: it does not connect
    with pytest.raises(ServerUnavailable):
        waiting.result(50)
    with pytest.raises(tf2.TransformException) as caught:
        buffer.lookup_transform("map", "base", LATEST)
    assert isinstance(caught.value, ServerUnavailable)
    start_server(endpoint=server.endpoint)
    assert buffer.can_transform("map", "base", LATEST) is False
