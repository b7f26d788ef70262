"""``zenoh-tf echo`` and ``wait``."""

from __future__ import annotations

import json
import threading
import time

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.support.command_line import Run, begun
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient


def test_echo_prints_again_and_again(robot: TransformClient, command: Run) -> None:
    start_s = time.monotonic()
    ended = command("echo", "base_link", "camera", "--rate", "20", "--count", "3", "--json")
    assert (ended.returncode, ended.stderr) == (0, "")
    answers = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [answer["translation"] for answer in answers] == [[0.1, 0.0, 0.2]] * 3
    assert time.monotonic() - start_s >= 2 / 20
    assert command("echo", "map", "odom", "--count", "1").stdout.startswith("odom in map\n")


def test_echo_waits_for_a_frame_and_says_so_once(robot: TransformClient, command: Run) -> None:
    row = StampedTransform("map", "late", 0, Transform())
    timer = threading.Timer(0.5, lambda: robot.set_transform(row, static=True))
    timer.start()
    ended = command("echo", "map", "late", "--rate", "20", "--count", "1")
    timer.join()
    assert ended.returncode == 0
    assert ended.stderr.splitlines() == [
        "zenoh-tf: LookupException: frame 'late' does not exist (waiting)"
    ]
    assert ended.stdout.startswith("late in map\n")


def test_echo_reports_as_json(robot: TransformClient, command: Run) -> None:
    row = StampedTransform("map", "later", 0, Transform())
    timer = threading.Timer(0.5, lambda: robot.set_transform(row, static=True))
    timer.start()
    ended = command("echo", "map", "later", "--rate", "20", "--count", "1", "--json")
    timer.join()
    assert json.loads(ended.stderr)["type"] == "LookupException"


def test_echo_prints_changes(robot: TransformClient) -> None:
    arguments = ["--on-change", "--json", "--count", "2"]
    with begun("echo", "map", "gate", *arguments) as process:
        assert process.stdout is not None and process.stderr is not None
        assert json.loads(process.stderr.readline())["type"] == "LookupException"
        for x in (1.0, 2.0):
            row = StampedTransform("map", "gate", 0, Transform((x, 0, 0)))
            robot.set_transform(row, static=True)
            assert json.loads(process.stdout.readline())["translation"] == [x, 0.0, 0.0]
        assert process.wait(30) == 0


def test_wait_for_a_frame(robot: TransformClient, command: Run) -> None:
    row = StampedTransform("map", "door", 0, Transform((1, 2, 3)))
    timer = threading.Timer(0.3, lambda: robot.set_transform(row, static=True))
    timer.start()
    ended = command("wait", "map", "door", "--for", "30s", "--json")
    timer.join()
    assert (ended.returncode, ended.stderr) == (0, "")
    assert json.loads(ended.stdout)["translation"] == [1.0, 2.0, 3.0]


def test_wait_in_vain(robot: TransformClient, command: Run) -> None:
    ended = command("wait", "map", "nobody", "--for", "0.1s")
    assert (ended.returncode, ended.stdout) == (1, "")
    assert "LookupException" in ended.stderr
    assert ended.stderr.endswith("; zenoh-tf explain map nobody says more\n")
    ended = command("wait", "map", "odom", "--at", "now+1000s", "--for", "0")
    assert "ForwardExtrapolationException" in ended.stderr


def test_wait_for_a_server(start_server: StartServer) -> None:
    endpoint = free_endpoint()
    with begun("wait", "a", "b", "--connect", endpoint, "--for", "50s") as process:
        time.sleep(0.5)
        with start_server(endpoint=endpoint).connect() as tf:
            tf.set_transform(StampedTransform("a", "b", 0, Transform()), static=True)
            out, err = process.communicate(timeout=150)
    assert (process.returncode, err) == (0, "")
    assert out.startswith("b in a\n")
