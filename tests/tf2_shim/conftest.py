"""The shim on a shared server, and ROS's modules as plain classes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes.servers import ServerProcess
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
def buffer(shim: TransformClient) -> tf2.Buffer:
    """map -> base at 1 s."""
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1), "wheels")
    return buffer
