"""Emulated ROS 2 peers as processes, and servers that join their network."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes.line_process import LineProcess
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient

#: No rotation, one metre ahead.
AHEAD = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Peer:
    """A process of tests/ros2/peer.py; each command is a method, which returns the answer."""

    def __init__(self, endpoint: str, mode: str = "peer", path: Path | None = None) -> None:
        """`path`: a folder with packages that come before the installed ones."""
        environment = dict(os.environ) if path is None else os.environ | {"PYTHONPATH": str(path)}
        script = Path(__file__).with_name("peer.py")
        self.process = LineProcess(script, endpoint, mode, env=environment)
        self.kill = self.process.kill

    def __getattr__(self, command: str) -> Callable[..., Any]:
        return lambda *arguments: json.loads(self.process.ask(json.dumps([command, *arguments])))


StartPeer = Callable[..., Peer]


@pytest.fixture
def start_peer() -> Iterator[StartPeer]:
    """``start_peer(endpoint, mode="peer")``, ended after the test."""
    running: list[Peer] = []

    def start(*arguments: Any) -> Peer:
        running.append(Peer(*arguments))
        return running[-1]

    yield start
    for peer in running:
        peer.kill()


@pytest.fixture(scope="module")
def server(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ServerProcess]:
    """A server with the file's FLAGS."""
    log = tmp_path_factory.mktemp("ros2") / "server.log"
    server = ServerProcess(log, free_endpoint(), "main", request.module.FLAGS)
    yield server
    server.stop()


def position(tf: TransformClient, target: str, source: str, timeout_s: float = 30.0) -> list[float]:
    """The translation of a frame in another, once there is one."""
    found = tf.lookup_transform(target, source, timeout_s=timeout_s)
    return [round(float(x), 9) for x in found.transform.translation]


def authorities(tf: TransformClient) -> dict[str, Any]:
    return {each.name: each for each in tf.authorities()}


def wait_for_authority(tf: TransformClient, name: str) -> Any:
    """The record of an authority, once there is one."""
    return wait_until(lambda: authorities(tf).get(name))
