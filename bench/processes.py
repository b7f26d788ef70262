"""Other processes of a benchmark, and the way to them."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from bench.machine import ROOT


@contextlib.contextmanager
def running(
    module: str, *arguments: str, python: str = sys.executable
) -> Iterator[subprocess.Popen[str]]:
    """A Python module as a process that has printed its first line and ends with the block."""
    command, pipe = [python, "-m", module, *arguments], subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(f"{module} did not start")
        try:
            yield process
        finally:
            process.terminate()


def request(process: subprocess.Popen[str], line: str) -> Any:
    """Sends a line, unless it is empty; returns the JSON that answers it."""
    assert process.stdin is not None and process.stdout is not None
    if line:
        print(line, file=process.stdin, flush=True)
    if answer := process.stdout.readline():
        return json.loads(answer)
    raise SystemExit(f"{process.args!r} ended early")


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
