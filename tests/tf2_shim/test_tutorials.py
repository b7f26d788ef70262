"""The nodes of examples/tf2_tutorials run together, as processes; rclpy is a stand-in."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes import forks

from .conftest import FAKE_ROS

FOLDER = Path(__file__).resolve().parents[2] / "examples/tf2_tutorials"


@pytest.fixture
def node(shared_server: Any) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``node(script, *arguments)``: a running node."""
    running: list[subprocess.Popen[str]] = []

    def start(script: str, *arguments: str) -> subprocess.Popen[str]:
        running.append(
            forks.Popen(
                [sys.executable, FOLDER / script, *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=os.environ
                | {"ZENOH_TF_CONNECT": shared_server.endpoint, "PYTHONPATH": str(FAKE_ROS)},
            )
        )
        return running[-1]

    yield start
    for process in running:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        assert (process.returncode, errors) == (0, "")


def line(process: subprocess.Popen[str], pattern: str) -> tuple[float, ...]:
    """The numbers of the next line that matches."""
    assert process.stdout is not None
    while text := process.stdout.readline():
        if found := re.fullmatch(pattern, text.strip()):
            return tuple(map(float, found.groups()))
    raise AssertionError(process.stderr.read() if process.stderr else "")


def test_all_nodes_together(shared_server: Any, node: Any) -> None:
    with shared_server.connect() as tf:
        follower = node("listener.py")
        line(follower, "no goal yet: LookupException")
        node("broadcaster.py")
        node("frame_adder.py")
        node("static_broadcaster.py", "laser", "0.2", "0", "0.4", "3.1416")
        distance, bearing = line(follower, r"goal at (\S+) m, (\S+) deg")
        assert distance == pytest.approx(1.0, abs=1e-3)
        assert -180.0 <= bearing <= 180.0

        traveller = node("time_travel.py")
        x, y = line(traveller, r"a second ago at x (\S+) y (\S+) of where it is now")
        # A tenth of a circle of 2 m; between samples that a busy machine sends late, it is a chord.
        assert x == pytest.approx(-1.1756, abs=0.3)
        assert y == pytest.approx(0.3820, abs=0.3)

        assert tf.can_transform("goal", "laser", timeout_s=30.0)
        laser = tf.frame("laser")
        assert (laser.parent, laser.static, laser.authority) == ("base_link", True, "/mount")
        assert tf.frame("goal").authority == "/goal"
