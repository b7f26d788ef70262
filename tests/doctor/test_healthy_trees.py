"""The doctor finds nothing in the robots of the demos, and in a recorded robot that is played."""

from __future__ import annotations

import functools
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.conftest import LendServer
from tests.processes.servers import ServerProcess
from tests.support import command_line
from tests.support.recorded import RUN, needs_recording
from zenoh_tf_client import TransformClient

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SENSORS = ("localisation", "wheels", "arm", "camera")
#: A rate needs some samples of the slowest link.
HISTORY_S = 1.0

pytestmark = [pytest.mark.slow, pytest.mark.own_server]


@contextmanager
def running(*commands: tuple[str, ...]) -> Iterator[None]:
    """Python programs that run meanwhile."""
    started = [
        subprocess.Popen([sys.executable, *command], cwd=EXAMPLES, stdout=subprocess.DEVNULL)
        for command in commands
    ]
    try:
        yield
        assert all(process.poll() is None for process in started)
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.wait()


def finds_nothing(server: ServerProcess, target: str, *sources: str) -> None:
    """The doctor, once all sources have a history."""
    with server.connect() as tf:
        for source in sources:
            assert tf.can_transform(target, source, timeout_s=60.0)
            wait_for_history(tf, source)
    done = command_line.run("--connect", server.endpoint, "doctor", "--for", "3s")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout


def wait_for_history(tf: TransformClient, name: str) -> None:
    frame = functools.partial(tf.frame, name)
    while (frame().newest_stamp_ns or 0) - (frame().oldest_stamp_ns or 0) < HISTORY_S * 1e9:
        time.sleep(0.05)


def test_the_demo(server: ServerProcess) -> None:
    with running(
        *(("-m", "demo_robot.sensors", each, "--connect", server.endpoint) for each in SENSORS)
    ):
        finds_nothing(server, "map", "object", "wrist")


def test_the_demo_of_ros_2(lend_server: LendServer) -> None:
    server = lend_server("--ros2", "--ros2-prefix", "namespace", "--ros2-shared", "map")
    with running(
        *(("ros2_robot.py", "--connect", server.endpoint, "--namespace", name) for name in "ab")
    ):
        finds_nothing(server, "map", "a/base_link", "b/base_link")


@needs_recording
@pytest.mark.parametrize(
    "options", [("--rate", "1"), ("--rate", "2", "--start", "+10s"), ("--clock", "now")]
)
def test_a_replay(server: ServerProcess, options: tuple[str, ...]) -> None:
    replay = ("-m", "zenoh_tf_tools", "--connect", server.endpoint, "replay", str(RUN), *options)
    with running(replay):
        finds_nothing(server, "map", "base_link")
