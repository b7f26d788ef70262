"""Other processes of a benchmark, and the way to them."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator

import zenoh

from bench.machine import ROOT
from zenoh_tf import zenoh_config


@contextlib.contextmanager
def running(module: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python module as a process that has said its first line and ends with the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(f"{module} did not start")
        try:
            yield process
        finally:
            process.terminate()


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def open_session(endpoint: str) -> zenoh.Session:
    """A Zenoh session, set up as the SDK's is."""
    return zenoh.open(zenoh_config.client([endpoint], 5.0))
