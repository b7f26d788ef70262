"""Processes that a test speaks with by lines."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from . import forks


class LineProcess(forks.Popen):
    """A Python program that prints a line when it is ready, and one for each line that it reads.
    Leaving the context ends its input, at which it ends, also if it was stopped."""

    def __init__(self, *command: str | Path, **options: Any) -> None:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        super().__init__([sys.executable, *command], **pipes, **options)
        self.read_line()

    def __exit__(self, *_: object) -> None:
        self.go_on()
        assert self.stdin is not None
        self.stdin.close()
        try:
            self.wait(20)
        finally:
            self.kill()

    def read_line(self) -> str:
        assert self.stdout is not None
        line = self.stdout.readline()
        assert line, f"{self.args!r} has ended"
        return line.strip()

    def say(self, line: str) -> None:
        assert self.stdin is not None
        self.stdin.write(line + "\n")
        self.stdin.flush()

    def ask(self, line: str = "") -> str:
        """The line with which it answers a line."""
        self.say(line)
        return self.read_line()

    def freeze(self) -> None:
        """Stop all of its threads, and return when they have stopped."""
        self.send_signal(signal.SIGSTOP)
        forks.wait_until_stopped(self.pid)

    def go_on(self) -> None:
        self.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """As ``kill -9``, and wait for its end."""
        super().kill()
        self.wait()
        for pipe in (self.stdin, self.stdout):
            if pipe is not None:
                pipe.close()
