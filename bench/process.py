"""Programs that a benchmark starts: they are ready at their first line, and answer by lines."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import zenoh

from bench.machine import ROOT
from zenoh_tf._net import zenoh_config


class Process(subprocess.Popen[str]):
    """A program that prints a line when it is ready, and answers each line of its stdin with a
    line of JSON. Leaving the context ends it."""

    def __init__(self, *command: str, wait: bool = True) -> None:
        pipe = subprocess.PIPE
        super().__init__(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        if wait:
            self.read_line()

    def read_line(self) -> str:
        """The next line that it prints; ends the benchmark if it has ended."""
        assert self.stdout is not None
        if line := self.stdout.readline():
            return line
        raise SystemExit(f"{self.args!r} ended with code {self.wait()}")

    def tell(self, line: str) -> None:
        assert self.stdin is not None
        print(line, file=self.stdin, flush=True)

    def ask(self, line: str = "") -> Any:
        self.tell(line)
        return json.loads(self.read_line())

    def __exit__(self, *error: object) -> None:
        self.terminate()
        super().__exit__(*error)  # type: ignore[arg-type]


def module(name: str, *arguments: str) -> Process:
    """A Python module as a process."""
    return Process(sys.executable, "-m", name, *arguments)


@contextlib.contextmanager
def listening(name: str, *arguments: str) -> Iterator[tuple[Process, str]]:
    """A module whose last argument is the endpoint on which it listens, and this endpoint."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with module(name, *arguments, endpoint) as process:
        yield process, endpoint


def server() -> contextlib.AbstractContextManager[tuple[Process, str]]:
    """A server with the defaults, and its endpoint."""
    return listening("zenoh_tf_server", "--log-level", "error", "--listen")


def connect(endpoint: str) -> zenoh.Session:
    return zenoh.open(zenoh_config.client([endpoint], 5.0))


def ask(session: zenoh.Session, key: str, payload: bytes) -> int:
    """The bytes of the reply to a query that is sent as the client sends its own."""
    once = zenoh.ConsolidationMode.NONE
    for reply in session.get(key, payload=payload, timeout=5.0, consolidation=once):
        assert reply.ok is not None
        return len(reply.ok.payload.to_bytes())
    raise SystemExit(f"no answer on {key}")
