"""A Zenoh router as a process: ``python -m tests.processes.router_process LISTEN CONNECT``."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading

import zenoh

from zenoh_tf._net import zenoh_config

from . import forks
from .ports import free_endpoint


class RouterProcess:
    """A running one, linked to the router at an endpoint."""

    def __init__(self, neighbour: str) -> None:
        self.endpoint = free_endpoint()
        self.process = forks.Popen(
            [sys.executable, "-m", "tests.processes.router_process", self.endpoint, neighbour],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def freeze(self) -> None:
        """Stop all of its threads, and return when they have stopped."""
        self.process.send_signal(signal.SIGSTOP)
        forks.wait_until_stopped(self.process.pid)

    def wake(self) -> None:
        """Let it run again."""
        self.process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def main() -> None:
    config = zenoh_config.router([sys.argv[1]])
    config.insert_json5("connect/endpoints", json.dumps([sys.argv[2]]))
    with zenoh.open(config) as session:
        while not list(session.info.routers_zid()):
            threading.Event().wait(0.01)
        print("ready", flush=True)
        threading.Event().wait()


if __name__ == "__main__":
    main()
