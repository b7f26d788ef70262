"""A Zenoh router as a process: ``python -m tests.processes.router_process LISTEN CONNECT``."""

from __future__ import annotations

import json
import sys
import threading

import zenoh

from zenoh_tf._net import zenoh_config

from .line_process import LineProcess
from .ports import free_endpoint


class RouterProcess(LineProcess):
    """A running one, linked to the router at an endpoint."""

    def __init__(self, neighbour: str) -> None:
        self.endpoint = free_endpoint()
        super().__init__("-m", "tests.processes.router_process", self.endpoint, neighbour)


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
