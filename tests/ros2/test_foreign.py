"""Peers that share no code with this project: an old Zenoh, and other projects' packages.

Each is skipped, with the reason, where its package is missing.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform

from .conftest import AHEAD, Peer, position, wait_for_authority

FLAGS = ("--ros2", "--ros2-publish")
OLD = "1.5.1"  # the Zenoh of ROS 2 Jazzy's and Kilted's first packages
FOREIGN = Path(__file__).with_name("foreign.py")
BUILD = Path(__file__).resolve().parents[2] / "build"
#: Where pyzeros keeps what it compiles.
COMPILED = BUILD / "cydr"
#: Where `make test-packages` installs the old Zenoh.
OLD_ZENOH = BUILD / f"packages/eclipse-zenoh-{OLD}"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def start_old_peer() -> Iterator[Callable[..., Peer]]:
    """``start(endpoint, mode)``: a peer on an old Zenoh."""
    if not OLD_ZENOH.exists():
        pytest.skip(f"no {OLD_ZENOH}: make test-packages installs it")
    running: list[Peer] = []

    def start(endpoint: str, mode: str = "peer") -> Peer:
        running.append(Peer(endpoint, mode, path=OLD_ZENOH))
        return running[-1]

    yield start
    for peer in running:
        peer.kill()


@pytest.mark.parametrize("humble", [False, True], ids=["newer", "humble"])
def test_a_node_on_an_old_zenoh(
    server: ServerProcess, start_old_peer: Callable[..., Peer], humble: bool
) -> None:
    name = f"old{humble}"
    peer = start_old_peer(server.endpoint)
    assert peer.version() == OLD
    peer.node("n", name, 0, "nav", humble)
    peer.listen("tf", humble)
    peer.send_static("n", [(f"{name}_base", f"{name}_laser", 1, AHEAD)])
    with server.connect() as tf:
        peer.send("n", [(f"{name}_odom", f"{name}_base", time.time_ns(), AHEAD)])
        assert position(tf, f"{name}_odom", f"{name}_laser") == [2.0, 0.0, 0.0]
        wait_for_authority(tf, f"ros2:0/{name}/nav")
        late = start_old_peer(server.endpoint)
        tf.set_transform(StampedTransform("map", name, 5, Transform(AHEAD[:3])), static=True)

        def heard() -> Any:
            tf.set_transform(StampedTransform("map", "old", time.time_ns(), Transform(AHEAD[:3])))
            return peer.heard()

        wait_until(heard)
        late.listen("tf_static", humble)
        wait_until(
            lambda: any(row[:2] == ["map", name] for _, _, rows in late.heard() for row in rows)
        )


def test_a_bridge_on_an_old_zenoh(
    server: ServerProcess, start_old_peer: Callable[..., Peer]
) -> None:
    peer = start_old_peer(server.endpoint, "bridge")
    peer.bridge("b", "oldbot")
    for child in ("laser", "camera"):
        peer.send_static("b", [("oldbot_base", f"oldbot_{child}", 1, AHEAD)])
    with server.connect() as tf:
        for child in ("laser", "camera"):
            assert position(tf, "oldbot_base", f"oldbot_{child}") == [1.0, 0.0, 0.0]


@pytest.mark.timeout(300)  # pyzeros compiles its messages when they are first used
@pytest.mark.parametrize(("package", "module"), [("sdk", "zenoh_ros2_sdk"), ("pyzeros", "pyzeros")])
def test_another_package(server: ServerProcess, package: str, module: str) -> None:
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")
    port = server.endpoint.rpartition(":")[2]
    heard: list[Any] = []
    with subprocess.Popen(
        [sys.executable, FOREIGN, package, port],
        stdout=subprocess.PIPE,
        env=os.environ | {"CYDR_CACHE_DIR": str(COMPILED)},
        text=True,
    ) as process:

        def read() -> None:
            assert process.stdout is not None
            heard.extend(json.loads(line) for line in process.stdout)

        reader = threading.Thread(target=read)
        reader.start()
        try:
            with server.connect() as tf:
                odom, base = f"{package}_odom", f"{package}_base"
                assert position(tf, odom, base, 240.0) == [1.0, 0.0, 0.0]
                names = [each.name for each in tf.authorities() if each.frames]
                assert any(name.startswith(("ros2:0/sdk/tf#", "ros2:0/pyzeros_")) for name in names)
                stamp_ns = time.time_ns()

                def set_until_heard() -> bool:
                    link = StampedTransform("map", "drone", stamp_ns, Transform((1, 2, 3)))
                    tf.set_transform(link)
                    return bool(heard)

                wait_until(set_until_heard)
                assert heard[0] == ["map", "drone", stamp_ns, [1, 2, 3]]
        finally:
            process.kill()
            reader.join()
