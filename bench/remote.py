"""The service from a client process: what a lookup costs, and what batches reach."""

from __future__ import annotations

import functools
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import zenoh

from bench import empty_server, workload
from bench.processes import free_endpoint, running
from bench.report import Cell, Report, Target, Trial, ratios
from bench.workload import ROWS, SOURCE, TARGET
from zenoh_tf import StampedTransform, Transform, keys, wire
from zenoh_tf_client import TransformClient, requests

TREE = "main"
#: Round trips of one trial. A round trip waits for the processor four times, so trials are short
#: and many: other work on the machine then meets all of them.
CALLS = 100
#: Transforms in a broadcaster's message.
BROADCAST_ROWS = 100


def measure(report: Report) -> None:
    """Microseconds a round trip; lookups and transforms a second."""
    endpoint = free_endpoint()
    command = ["zenoh_tf_server", "--listen", endpoint, "--tree", TREE, "--log-level", "error"]
    with running(*command), TransformClient.connect(endpoint, TREE) as tf:
        for parent, child, stamp_ns, *pose in workload.history():
            tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform(*pose)))
        _round_trips(report, tf, endpoint)
        _batches(report, tf)
        _broadcasts(report, tf)


def open_session(endpoint: str) -> zenoh.Session:
    """A Zenoh session, set up as the SDK's is."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    for feature in ("scouting/multicast", "scouting/gossip", "transport/shared_memory"):
        config.insert_json5(f"{feature}/enabled", "false")
    return zenoh.open(config)


def _round_trips(report: Report, tf: TransformClient, endpoint: str) -> None:
    """A lookup, its messages without the client, and an empty query of as many bytes."""
    request = wire.pack(requests.lookup_transform(TARGET, SOURCE).body())
    key, empty_endpoint = keys.operation(TREE, "lookup"), free_endpoint()
    with open_session(endpoint) as session:
        reply_bytes = _ask(session, key, request)
        with (
            running("bench.empty_server", empty_endpoint, str(reply_bytes)),
            open_session(empty_endpoint) as empty,
        ):
            calls: dict[str, Callable[[], object]] = {
                "lookup_transform": lambda: tf.lookup_transform(TARGET, SOURCE),
                "its messages": lambda: _ask(session, key, request),
                "empty query": lambda: _ask(empty, empty_server.KEY, bytes(len(request))),
            }
            labels = {"case": f"round trip of {len(request)} and {reply_bytes} bytes"}
            cells = [Cell(labels, name, run=_round_trip(call)) for name, call in calls.items()]
            for cell in cells:
                cell.run()  # warms up
            report.measure("remote", cells, report.repetitions(21), baseline="empty query")
    values = ratios(cells[0].values("us_per_call"), cells[2].values("us_per_call"))
    report.check("remote", [Target("lookup_transform to an empty query", 1.3, values, False)])


def _round_trip(call: Callable[[], object]) -> Callable[[], Trial]:
    def trial() -> Trial:
        spent_s = []
        for _ in range(CALLS):
            start = time.perf_counter()
            call()
            spent_s.append(time.perf_counter() - start)
        return {"us_per_call": 1e6 * statistics.median(spent_s)}

    return trial


def _ask(session: zenoh.Session, key: str, payload: bytes) -> int:
    """The bytes of the reply to a query that is sent as the client sends its own."""
    once = zenoh.ConsolidationMode.NONE
    for reply in session.get(key, payload=payload, timeout=5.0, consolidation=once):
        assert reply.ok is not None
        return len(reply.ok.payload.to_bytes())
    raise SystemExit(f"no answer on {key}")


def _batches(report: Report, tf: TransformClient) -> None:
    times_ns = workload.times_ns()
    array = np.array(times_ns)
    targets, sources = [TARGET] * ROWS, [SOURCE] * ROWS
    calls = 2 if report.quick else 40

    def recorded() -> None:
        with tf.batch() as batch:
            handles = [batch.lookup_transform(TARGET, SOURCE, at) for at in times_ns]
        for handle in handles:
            handle.result()

    def trial(call: Callable[[], object]) -> Trial:
        start = time.perf_counter()
        for _ in range(calls):
            call()
        return {"rows_per_s": calls * ROWS / (time.perf_counter() - start)}

    lookup = tf.lookup_transforms
    for name, call, limit in (
        (f"lookup_transforms, {ROWS} rows", lambda: lookup(TARGET, SOURCE, array), 300_000),
        ("the same, names on either side", lambda: lookup(targets, sources, array), 300_000),
        (f"a batch of {ROWS} lookup_transform", recorded, 0),
    ):
        _rate(report, name, functools.partial(trial, call), limit)


def _broadcasts(report: Report, tf: TransformClient) -> None:
    """Transforms a second from the first message until the server has counted the last."""
    transform, stamps_ns = Transform(*workload.pose(0, 0)), workload.later_ns()
    frames = [f"joint{i}" for i in range(BROADCAST_ROWS)]
    messages = 10 if report.quick else 1000

    def message() -> list[StampedTransform]:
        stamp_ns = next(stamps_ns)
        return [StampedTransform(TARGET, frame, stamp_ns, transform) for frame in frames]

    with tf.broadcaster("bench") as sender:

        def trial(built: bool) -> Trial:
            ready = [message() for _ in range(messages)] if built else None
            rows = messages * BROADCAST_ROWS
            expected = tf.stats()["put_transforms"] + rows
            start = time.perf_counter()
            for i in range(messages):
                sender.send(ready[i] if ready else message())
            while tf.stats()["put_transforms"] < expected:
                if time.perf_counter() > start + 60:
                    raise SystemExit(f"transforms were lost: {tf.stats()}")
                time.sleep(0.001)
            return {"rows_per_s": rows / (time.perf_counter() - start)}

        name = f"broadcaster, messages of {BROADCAST_ROWS}"
        _rate(report, name, lambda: trial(True), 300_000)
        _rate(report, f"{name}, with building them", lambda: trial(False), 0)


def _rate(report: Report, name: str, trial: Callable[[], Trial], limit: float) -> None:
    trial()  # warms up
    cell = Cell({"case": name}, "zenoh-tf", run=trial)
    report.measure("remote", [cell], report.repetitions())
    if limit:
        report.check("remote", [Target(f"{name}, rows/s", limit, cell.values("rows_per_s"))])
