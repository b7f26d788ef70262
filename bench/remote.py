"""The service from a client process: what a lookup costs, and what batches reach."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable

import numpy as np
import zenoh

from bench import empty_server, workload
from bench.processes import free_endpoint, running
from bench.report import Cell, Report, Target, Trial, ratios
from bench.workload import ROWS, SOURCE, TARGET
from zenoh_tf import StampedTransform, Transform, keys, wire, zenoh_config
from zenoh_tf_client import TransformClient, requests

TREE = "main"


def measure(report: Report) -> None:
    """Microseconds a round trip; lookups and transforms a second."""
    endpoint = free_endpoint()
    command = ["zenoh_tf_server", "--listen", endpoint, "--tree", TREE, "--log-level", "error"]
    with running(*command), TransformClient.connect(endpoint, TREE) as tf:
        for parent, child, stamp_ns, *pose in workload.history():
            tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform(*pose)))
        _round_trips(report, tf, endpoint)
        _rates(report, tf)


def _round_trips(report: Report, tf: TransformClient, endpoint: str) -> None:
    """A lookup, its messages without the client, and an empty query of as many bytes."""
    request = wire.pack(requests.lookup_transform(TARGET, SOURCE).body())
    key, empty_endpoint = keys.operation(TREE, "lookup"), free_endpoint()
    with zenoh.open(zenoh_config.client([endpoint], 5.0)) as session:
        reply_bytes = _ask(session, key, request)
        with (
            running("bench.empty_server", empty_endpoint, str(reply_bytes)),
            zenoh.open(zenoh_config.client([empty_endpoint], 5.0)) as empty,
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
    """Short trials and many: a round trip waits for the processor four times."""

    def trial() -> Trial:
        spent_s = []
        for _ in range(100):
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


def _rates(report: Report, tf: TransformClient) -> None:
    """Lookups a second; transforms a second until the server has counted the last."""
    times_ns, later_ns = np.array(workload.times_ns()), workload.later_ns()
    calls, transform = 2 if report.quick else 40, Transform(*workload.pose(0, 0))

    def lookups() -> Trial:
        start = time.perf_counter()
        for _ in range(calls):
            tf.lookup_transforms(TARGET, SOURCE, times_ns)
        return {"rows_per_s": calls * ROWS / (time.perf_counter() - start)}

    def sets() -> Trial:
        messages = [
            [StampedTransform(TARGET, f"joint{i}", at_ns, transform) for i in range(ROWS // 10)]
            for at_ns in itertools.islice(later_ns, 10 * calls)
        ]
        expected = tf.stats()["put_transforms"] + calls * ROWS
        start = time.perf_counter()
        for message in messages:
            sender.send(message)
        while tf.stats()["put_transforms"] < expected:
            if time.perf_counter() > start + 60:
                raise SystemExit(f"transforms were lost: {tf.stats()}")
            time.sleep(0.001)
        return {"rows_per_s": calls * ROWS / (time.perf_counter() - start)}

    with tf.broadcaster("bench") as sender:
        for name, run in (
            (f"lookup_transforms, {ROWS} rows", lookups),
            (f"broadcaster, messages of {ROWS // 10}", sets),
        ):
            cell = Cell({"case": name}, "zenoh-tf", run=run)
            cell.run()  # warms up
            report.measure("remote", [cell], report.repetitions())
            rates = cell.values("rows_per_s")
            report.check("remote", [Target(f"{name}, rows/s", 300_000, rates)])
