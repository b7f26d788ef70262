"""Buffers on a shared server and with a tree of their own, and ROS's modules as plain classes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import zenoh_tf.tf2
from tests.processes.servers import ServerProcess
from zenoh_tf.tf2 import topics
from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient

#: Modules with ROS's names and plain classes, for the scripts of these tests.
FAKE_ROS = Path(__file__).with_name("fake_ros")
sys.path.append(str(FAKE_ROS))

from .messages import link  # noqa: E402 - its imports are in that folder


@pytest.fixture
def shim(
    shared_server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> Iterator[TransformClient]:
    """The process's connection leads to `shared_server`, which holds nothing but names."""
    monkeypatch.setenv("ZENOH_TF_CONNECT", shared_server.endpoint)
    client = tf2.connect()
    client.clear(keep_static=False)
    yield client
    tf2.close()


@pytest.fixture
def process_topics() -> Iterator[None]:
    """The topics of the process are as new."""
    topics._statics.clear()
    yield
    topics._statics.clear()


@pytest.fixture(params=["server", "own tree"])
def make_buffer(request: pytest.FixtureRequest) -> Callable[..., zenoh_tf.tf2.Buffer]:
    """Makes a buffer on the server's tree, or with one of its own."""
    if request.param == "own tree":
        return zenoh_tf.tf2.Buffer
    request.getfixturevalue("shim")
    return tf2.Buffer


@pytest.fixture
def buffer(make_buffer: Callable[..., zenoh_tf.tf2.Buffer]) -> zenoh_tf.tf2.Buffer:
    """map -> base at 1 s."""
    buffer = make_buffer()
    buffer.set_transform(link("map", "base", 1), "wheels")
    return buffer


def waiters(buffer: zenoh_tf.tf2.Buffer) -> int:
    """How many lookups wait in the buffer's tree."""
    waiting: int = buffer._source.tree().stats()["waiters"]
    return waiting
