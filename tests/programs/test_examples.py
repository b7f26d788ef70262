"""Every example runs against a real server. That pages show them is checked by ``make lint``."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.processes import forks
from zenoh_tf_client import TransformClient

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


def run(name: str, endpoint: str) -> str:
    done = forks.run(
        [sys.executable, EXAMPLES / name, "--connect", endpoint],
        timeout=150,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_sensor_and_client(server: Any) -> None:
    command = [sys.executable, EXAMPLES / "sensor.py", "--connect", server.endpoint]
    sensor = forks.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with TransformClient.connect(server.endpoint) as tf:
            while not tf.can_transform("map", "camera"):
                assert sensor.poll() is None
                time.sleep(0.05)
            since_ns = tf.lookup_transform("map", "camera").stamp_ns  # the start may take long
            while not tf.can_transform("map", "camera", since_ns + 10**9):
                assert sensor.poll() is None
                time.sleep(0.05)
        lines = run("client.py", server.endpoint).splitlines()
        sensor.send_signal(signal.SIGINT)
        assert (sensor.communicate(timeout=150), sensor.returncode) == (("", ""), 0)
    finally:
        if sensor.poll() is None:
            sensor.kill()
            sensor.wait()
    assert [line.split(":")[0] for line in lines] == [
        "now",
        "a quarter of a second before",
        "moved",
    ]
    now, then, moved = (_numbers(line) for line in lines)
    assert now[0] > then[0]
    assert now[1:] == [0.0, 0.5]  # the static link
    assert moved[0] == pytest.approx(now[0] - then[0], abs=1e-6)


def test_transaction(server: Any) -> None:
    assert _numbers(run("transaction.py", server.endpoint)) == pytest.approx([0.0, 0.0, 0.3])


def test_async_client(server: Any) -> None:
    lines = run("async_client.py", server.endpoint).splitlines()
    assert lines == ["wheels: 0.0 1.0 2.0 3.0", "the last: 3.0"]


@pytest.mark.slow
def test_docking(server: Any) -> None:
    """It has to wait for a history, and to stop in the glare; no error may exceed its limit."""
    *waits, docked, steps = run("docking.py", server.endpoint).splitlines()
    assert waits and all(line.startswith("stands still: ") for line in waits)
    left_mm, within_mm = _numbers(docked)
    assert left_mm <= 10 and within_mm <= 30
    moved, stood = _numbers(steps)
    assert moved > 0 and stood > 10


def _numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", line)]
