"""Commands as processes, without and with a terminal."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from collections.abc import Callable

import pytest

Done = subprocess.CompletedProcess[str]
Run = Callable[..., Done]

MODULE = ("-m", "zenoh_tf_client")


@pytest.fixture
def zenoh_tf() -> Run:
    """``zenoh_tf(*args)``: one command, to its end. ``start``: another way to start it."""

    def run(*args: str, start: tuple[str, ...] = MODULE) -> Done:
        return subprocess.run(
            [sys.executable, *start, *args],
            capture_output=True,
            text=True,
            timeout=40,
            check=False,
        )

    return run


@pytest.fixture
def in_terminal() -> Callable[..., str]:
    """``in_terminal(*args, **environment)``: what a command writes to a terminal."""

    def run(*args: str, **environment: str) -> str:
        ours, theirs = pty.openpty()
        inherited = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
        with subprocess.Popen(
            [sys.executable, *MODULE, *args],
            stdout=theirs,
            stderr=theirs,
            env={**inherited, "TERM": "xterm", **environment},
        ) as process:
            os.close(theirs)
            output = b""
            try:
                while piece := os.read(ours, 4096):
                    output += piece
            except OSError:  # how Linux says that the other end is closed
                pass
            os.close(ours)
            assert process.wait(30) == 0, output
        return output.decode()

    return run
