"""Emulated ROS 2 peers as processes, and servers that join their network."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import START_TIMEOUT_S, ServerProcess
from zenoh_tf_client import TransformClient

#: No rotation, one metre ahead.
AHEAD = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class Peer:
    """A process of tests/ros2/peer.py; each command is a method, which returns the answer."""

    def __init__(self, endpoint: str, mode: str = "peer", path: Path | None = None) -> None:
        """`path`: a folder with packages that come before the installed ones."""
        environment = dict(os.environ) if path is None else os.environ | {"PYTHONPATH": str(path)}
        self.process = forks.Popen(
            [sys.executable, Path(__file__).with_name("peer.py"), endpoint, mode],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._answer()

    def __getattr__(self, command: str) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            assert self.process.stdin is not None
            self.process.stdin.write(json.dumps([command, *arguments]) + "\n")
            self.process.stdin.flush()
            return self._answer()

        return run

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the peer has ended"
        return json.loads(line)

    def kill(self) -> None:
        """As ``kill -9``."""
        self.process.kill()
        self.process.wait(10)
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()


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


def make_server(folder: Path, *flags: str) -> ServerProcess:
    return ServerProcess(folder / "server.log", free_endpoint(), "main", flags)


def wait_for(what: Callable[[], Any]) -> Any:
    """Wait until a function returns something true, and return that."""
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while not (found := what()):
        assert time.monotonic() < deadline_s, "it does not become true"
        time.sleep(0.01)
    return found


def position(tf: TransformClient, target: str, source: str, timeout_s: float = 30.0) -> list[float]:
    """The translation of a frame in another, once there is one."""
    found = tf.lookup_transform(target, source, timeout_s=timeout_s)
    return [round(float(x), 9) for x in found.transform.translation]


def authorities(tf: TransformClient) -> dict[str, Any]:
    return {each.name: each for each in tf.authorities()}


def wait_for_authority(tf: TransformClient, name: str) -> Any:
    """The record of an authority, once there is one."""
    return wait_for(lambda: authorities(tf).get(name))
