"""The service from a client process: many lookups in a call, and lookups that wait."""

from __future__ import annotations

import contextlib
import functools
import time
import timeit
from collections.abc import Callable, Iterator

import numpy as np
import zenoh

from bench.machine import cpu_s
from bench.process import connect, server
from bench.python_system import ROWS, SOURCE, TARGET, TIMES_NS, history
from bench.report import Cell, Report, Target, Trial
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests import lookups as lookup_requests

LOOKUP = keys.request("main", "lookup")
#: Each waiting lookup gives up after this; none should come near it.
WAIT_S = 120.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000


def fill(tf: TransformClient) -> None:
    """Ten seconds at 100 Hz of a chain of depth 4."""
    rows = [StampedTransform(*row[:3], Transform(*row[3:])) for row in history()]
    for begin in range(0, len(rows), ROWS):
        tf.set_transforms_xact(rows[begin : begin + ROWS])


def rows(report: Report) -> None:
    """Lookups a second, many in a call."""
    calls = 2 if report.quick else 40
    with server() as (_, endpoint), TransformClient.connect(endpoint, reads="query") as tf:
        fill(tf)
        call = functools.partial(tf.lookup_transforms, TARGET, SOURCE, np.array(TIMES_NS))

        def trial() -> Trial:
            return {"rows_per_s": calls * ROWS / timeit.timeit(call, number=calls)}

        trial()  # warms up
        cell = Cell({"case": f"lookup_transforms, {ROWS} rows"}, "zenoh-tf", run=trial)
        report.measure([cell], report.repetitions(15))
        rates = cell.values("rows_per_s")
        report.check([Target("lookup_transforms by query, rows/s", 300_000, rates)])


def waiting(report: Report) -> None:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    lookups = 500 if report.quick else 5000
    frames = [f"frame{index}" for index in range(lookups)]
    came_ns = np.zeros(lookups)
    with (
        server() as (process, endpoint),
        TransformClient.connect(endpoint, timeout_s=30.0, reads="query") as tf,
        waiting_client(endpoint) as session,
    ):
        tf.set_transforms_xact([_stamped(frame, BEFORE_NS) for frame in frames])
        for index, frame in enumerate(frames):

            def on_reply(reply: zenoh.Reply, index: int = index) -> None:
                if reply.ok is not None:
                    came_ns[index] = time.monotonic_ns()

            wait(session, "map", frame, on_reply)
        wait_for_waiters(tf, lookups)
        idle_s, before_s = report.seconds(5.0), cpu_s(process.pid)
        time.sleep(idle_s)
        idle_percent = 100 * (cpu_s(process.pid) - before_s) / idle_s
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
    report.measure([Cell(labels, "zenoh-tf", trials=[trial])], 0)


@contextlib.contextmanager
def waiting_client(endpoint: str) -> Iterator[zenoh.Session]:
    """A session that the server knows as a client, so that its lookups may wait for long."""
    with (
        connect(endpoint) as session,
        session.liveliness().declare_token(keys.client("main", str(session.zid()))),
    ):
        time.sleep(0.5)  # the server takes tokens on another thread than queries
        yield session


def wait_for_waiters(tf: TransformClient, count: int) -> None:
    """Returns when so many lookups wait at the server."""
    deadline = time.monotonic() + WAIT_S
    while tf.stats()["waiters"] < count:
        if time.monotonic() > deadline:
            raise SystemExit("the server did not accept all lookups that wait")
        time.sleep(0.05)


def wait(
    session: zenoh.Session, target: str, source: str, on_reply: Callable[[zenoh.Reply], None]
) -> None:
    """Sends a lookup that waits for a later time than any that is there."""
    request = lookup_requests.lookup_transform(target, source, WANTED_NS, WAIT_S)
    session.get(
        LOOKUP,
        on_reply,
        payload=wire.pack(request.body()),
        attachment=str(session.zid()),
        timeout=2 * WAIT_S,
        consolidation=zenoh.ConsolidationMode.NONE,
    )


def _stamped(frame: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", frame, stamp_ns, Transform((1.0, 2.0, 3.0)))
