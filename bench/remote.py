"""The service from a client process: round trips, many lookups in a call, and waiting lookups."""

from __future__ import annotations

import contextlib
import functools
import socket
import statistics
import subprocess
import sys
import time
import timeit
from collections.abc import Callable, Iterator

import numpy as np
import zenoh

from bench import empty_server
from bench.machine import ROOT, cpu_s
from bench.python_system import ROWS, SOURCE, TARGET, TIMES_NS, history
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, keys, wire, zenoh_config
from zenoh_tf_client import TransformClient, lookup_requests

LOOKUP, ONCE = keys.operation("main", "lookup"), zenoh.ConsolidationMode.NONE
SERVER = ("zenoh_tf_server", "--log-level", "error", "--listen")
#: Each waiting lookup gives up after this; none should come near it.
WAIT_S = 120.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000


@contextlib.contextmanager
def running(module: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A Python module as a process that has printed its first line, and its endpoint."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", module, *arguments, endpoint]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            if not process.stdout.readline():
                raise SystemExit(f"{module} did not start")
            yield process, endpoint
        finally:
            process.terminate()


def connect(endpoint: str) -> zenoh.Session:
    return zenoh.open(zenoh_config.client([endpoint], 5.0))


def measure(report: Report) -> None:
    """Microseconds a round trip; lookups a second."""
    with running(*SERVER) as (_, endpoint), TransformClient.connect(endpoint, reads="query") as tf:
        for parent, child, stamp_ns, *pose in history():
            tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform(*pose)))
        _round_trips(report, tf, endpoint)
        _rows(report, tf)


def _round_trips(report: Report, tf: TransformClient, endpoint: str) -> None:
    """A lookup beside an empty query of as many bytes."""
    request = wire.pack(lookup_requests.lookup_transform(TARGET, SOURCE).body())
    with connect(endpoint) as session:
        reply_bytes = ask(session, LOOKUP, request)
    with (
        running("bench.empty_server", str(reply_bytes)) as (_, empty_endpoint),
        connect(empty_endpoint) as empty,
    ):
        calls: dict[str, Callable[[], object]] = {
            "lookup_transform": lambda: tf.lookup_transform(TARGET, SOURCE),
            "empty query": lambda: ask(empty, empty_server.KEY, bytes(len(request))),
        }
        labels = {"case": f"round trip of {len(request)} and {reply_bytes} bytes"}
        trials = {name: functools.partial(_round_trip, call) for name, call in calls.items()}
        cells = [Cell(labels, name, run=trial) for name, trial in trials.items()]
        for cell in cells:
            cell.run()  # warms up
        report.measure("remote", cells, report.repetitions(21), baseline="empty query")
    values = ratios(*(cell.values("us_per_call") for cell in cells))
    report.check("remote", [Target("lookup_transform to an empty query", 1.3, values, False)])


def _round_trip(call: Callable[[], object]) -> Trial:
    """Short trials and many: a round trip waits for the processor four times."""
    return {"us_per_call": 1e6 * statistics.median(timeit.repeat(call, number=1, repeat=100))}


def ask(session: zenoh.Session, key: str, payload: bytes) -> int:
    """The bytes of the reply to a query that is sent as the client sends its own."""
    for reply in session.get(key, payload=payload, timeout=5.0, consolidation=ONCE):
        assert reply.ok is not None
        return len(reply.ok.payload.to_bytes())
    raise SystemExit(f"no answer on {key}")


def _rows(report: Report, tf: TransformClient) -> None:
    """Lookups a second, many in a call."""
    calls = 2 if report.quick else 40
    call = functools.partial(tf.lookup_transforms, TARGET, SOURCE, np.array(TIMES_NS))

    def trial() -> Trial:
        return {"rows_per_s": calls * ROWS / timeit.timeit(call, number=calls)}

    trial()  # warms up
    cell = Cell({"case": f"lookup_transforms, {ROWS} rows"}, "zenoh-tf", run=trial)
    report.measure("remote", [cell], report.repetitions())
    rates = cell.values("rows_per_s")
    report.check("remote", [Target("lookup_transforms, rows/s", 300_000, rates)])


def waiting(report: Report) -> None:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    lookups = 500 if report.quick else 5000
    frames = [f"frame{index}" for index in range(lookups)]
    came_ns = np.zeros(lookups)
    with (
        running(*SERVER) as (server, endpoint),
        TransformClient.connect(endpoint, timeout_s=30.0, reads="query") as tf,
        connect(endpoint) as session,
    ):
        tf.set_transforms_xact([_stamped(frame, BEFORE_NS) for frame in frames])
        for index, frame in enumerate(frames):

            def on_reply(reply: zenoh.Reply, index: int = index) -> None:
                if reply.ok is not None:
                    came_ns[index] = time.monotonic_ns()

            payload = wire.pack(
                lookup_requests.lookup_transform("map", frame, WANTED_NS, WAIT_S).body()
            )
            session.get(LOOKUP, on_reply, payload=payload, timeout=2 * WAIT_S, consolidation=ONCE)
        while tf.stats()["waiters"] < lookups:
            time.sleep(0.1)
        idle_s, before_s = report.seconds(5.0), cpu_s(server.pid)
        time.sleep(idle_s)
        idle_percent = 100 * (cpu_s(server.pid) - before_s) / idle_s
        released_ns = np.zeros(lookups)
        for index, frame in enumerate(frames):
            released_ns[index] = time.monotonic_ns()
            tf.set_transform(_stamped(frame, WANTED_NS))
        deadline = time.monotonic() + WAIT_S
        while not came_ns.all():
            if time.monotonic() > deadline:
                raise SystemExit("a lookup had no answer")
            time.sleep(0.1)
    spent_us = (came_ns - released_ns) / 1000
    p50, p99, worst = map(float, np.percentile(spent_us, (50, 99, 100)))
    trial = {"us_p50": p50, "us_p99": p99, "us_worst": worst, "idle_cpu_percent": idle_percent}
    labels = {"case": f"{lookups} waiting lookups, from commit to answer"}
    report.measure("waiting", [Cell(labels, "zenoh-tf", trials=[trial])], 0)


def _stamped(frame: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", frame, stamp_ns, Transform((1.0, 2.0, 3.0)))
