"""The service from a client process: the cost of a lookup, and what batches reach."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import zenoh

from bench import empty_server
from bench.timing import END_NS, FRAMES, START_NS, history, median_of_each_s
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

ROWS = 1000
BROADCAST_ROWS = 100
# The server gives up a publisher that waits longer; far below that the rate is the server's own.
BROADCASTS_MAX = 5000


def measure(seconds: float) -> dict[str, float]:
    """Microseconds a round trip; lookups and transforms a second."""
    figures = _measure_empty(seconds)
    endpoint = _free_endpoint()
    command = ["zenoh_tf_server", "--listen", endpoint, "--cache-time", "1e6"]
    with _process(*command, "--log-level", "error"), TransformClient.connect(endpoint) as tf:
        figures |= _measure_service(tf, seconds)
    figures["lookup_per_empty"] = round(figures["lookup_p50_us"] / figures["empty_p50_us"], 3)
    return figures


def _measure_empty(seconds: float) -> dict[str, float]:
    endpoint = _free_endpoint()
    with (
        _process("bench.empty_server", endpoint),
        zenoh.open(empty_server.configuration("client", endpoint)) as session,
    ):
        asker = session.declare_querier(
            empty_server.KEY, consolidation=zenoh.ConsolidationMode.NONE
        )

        def ask() -> None:
            for reply in asker.get():
                assert reply.ok is not None

        return {"empty_p50_us": round(1e6 * median_of_each_s(ask, seconds), 1)}


def _measure_service(tf: TransformClient, seconds: float) -> dict[str, float]:
    tf.set_transforms_xact(history())
    target, source = FRAMES[0], FRAMES[-1]
    stamps_ns = np.linspace(START_NS, END_NS, ROWS).astype(np.int64)
    one_s = median_of_each_s(lambda: tf.lookup_transform(target, source), seconds)
    many_s = median_of_each_s(lambda: tf.lookup_transforms(target, source, stamps_ns), seconds)
    return {
        "lookup_p50_us": round(1e6 * one_s, 1),
        "batched_lookups_per_s": round(ROWS / many_s),
        "broadcast_transforms_per_s": round(_broadcast_rate(tf, seconds)),
    }


def _broadcast_rate(tf: TransformClient, seconds: float) -> float:
    """Transforms a second from the first put until the server has committed the last."""
    sender = tf.broadcaster("bench")
    pose = Transform((1.0, 2.0, 3.0))
    start = time.perf_counter()
    sent = 0
    while time.perf_counter() < start + seconds and sent < BROADCASTS_MAX:
        sent += 1
        sender.send(
            [StampedTransform("map", f"b{i}", END_NS + sent, pose) for i in range(BROADCAST_ROWS)]
        )
    last = f"b{BROADCAST_ROWS - 1}"
    while not tf.can_transform("map", last, END_NS + sent):
        time.sleep(0.001)
    return sent * BROADCAST_ROWS / (time.perf_counter() - start)


@contextlib.contextmanager
def _process(module: str, *arguments: str) -> Iterator[None]:
    """A Python module as a process that has said its first line and ends with the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(f"{module} did not start")
        try:
            yield
        finally:
            process.terminate()


def _free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
