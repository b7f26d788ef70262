"""Servers as processes, and the chain of links that benchmarks look up."""

from __future__ import annotations

import socket
import sys

import zenoh

from bench.parts.chain import ROWS, Row, history
from bench.process import Process
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf_client import TransformClient

LOOKUP = keys.request("main", "lookup")


class Server(Process):
    """A server with these flags and an endpoint of its own."""

    def __init__(self, *flags: str) -> None:
        self.endpoint = free_endpoint()
        flags = ("--log-level", "error", *flags, "--listen", self.endpoint)
        super().__init__(sys.executable, "-m", "zenoh_tf_server", *flags)


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def query_client(endpoint: str) -> TransformClient:
    """A client that reads by query."""
    return TransformClient.connect(endpoint, timeout_s=30.0, reads="query")


def shared_client(endpoint: str) -> TransformClient:
    """A client that reads the server's memory."""
    tf = TransformClient.connect(endpoint)
    if tf.reads != "shared":
        raise SystemExit("the server does not share its tree")
    return tf


def session(endpoint: str) -> zenoh.Session:
    return zenoh.open(zenoh_config.client([endpoint], 5.0))


def stamped(row: Row) -> StampedTransform:
    return StampedTransform(*row[:3], Transform(*row[3:]))


def fill(tree: TransformTree | TransformClient) -> None:
    """Ten seconds at 100 Hz of a chain of depth 4."""
    rows = [stamped(row) for row in history()]
    for begin in range(0, len(rows), ROWS):
        tree.set_transforms_xact(rows[begin : begin + ROWS])
