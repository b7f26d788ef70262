"""``zenoh-tf echo`` and ``wait``, and the key ``q`` that ends what runs until Ctrl-C."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from tests.conftest import StartServer
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.support.command_line import MODULE, Run, begun
from tests.support.threads import beside
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

Read = Callable[[str], None]
FOREVER = [
    ("echo", "map", "odom", "--rate", "50"),
    ("echo", "base_link", "camera", "--on-change"),
    ("monitor", "--every", "0.1s"),
    ("top", "--every", "0.1s"),
]


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


@contextmanager
def on_terminal(*args: str) -> Iterator[tuple[subprocess.Popen[str], int, Read]]:
    """A command whose terminal is ours: the process, the terminal, and what reads the output up to
    some text."""
    ours, theirs = pty.openpty()
    # A session of its own, whose terminal this is: only so its foreground is known.
    code = (
        "import os, sys, fcntl, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
        "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    )
    with forks.Popen(
        [sys.executable, "-c", code, *MODULE, *args], stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        output = bytearray()
        came = threading.Condition()

        def drain(_: threading.Event) -> None:
            with suppress(OSError):  # how Linux says that the other end is closed
                while piece := os.read(ours, 4096):
                    with came:
                        output.extend(piece)
                        came.notify_all()

        def read(text: str) -> None:
            with came:
                assert came.wait_for(lambda: text.encode() in output, 60), bytes(output)

        with beside(drain):  # a process whose output nobody reads would wait
            try:
                yield process, ours, read
            finally:
                process.kill()
                process.wait()
                os.close(theirs)
        os.close(ours)


@pytest.mark.parametrize("command", FOREVER, ids=lambda command: " ".join(command[:2]))
def test_q_ends_it(robot: TransformClient, command: tuple[str, ...]) -> None:
    with on_terminal(*command) as (process, terminal, read):
        before = termios.tcgetattr(terminal)
        read("base_link" if command[0] != "echo" else "translation")
        os.write(terminal, b"xq")
        assert process.wait(30) == 0
        assert termios.tcgetattr(terminal) == before


def test_ctrl_c_still_does(robot: TransformClient) -> None:
    with on_terminal("monitor", "--every", "0.1s") as (process, terminal, read):
        before = termios.tcgetattr(terminal)
        read("base_link")
        os.write(terminal, b"\x03")
        assert process.wait(30) == -signal.SIGINT
        read("interrupted")
        assert termios.tcgetattr(terminal) == before


def test_input_that_is_no_terminal_is_left_alone(robot: TransformClient) -> None:
    done = subprocess.run(
        [sys.executable, *MODULE, "monitor", "--every", "0.1s", "--count", "2"],
        input="q",
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stdout.count("links\n") == 2
