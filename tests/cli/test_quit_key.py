"""The key ``q`` ends what otherwise runs until Ctrl-C, in a terminal only."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from tests.processes import forks
from tests.support.command_line import MODULE
from tests.support.threads import beside
from zenoh_tf_client import TransformClient

Read = Callable[[str], None]
FOREVER = [
    ("echo", "map", "odom", "--rate", "50"),
    ("echo", "base_link", "camera", "--on-change"),
    ("monitor", "--every", "0.1s"),
    ("top", "--every", "0.1s"),
]


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
