"""The service from a client process: many lookups in a call, lookups that wait, and what a server
needs of its host, for docs/how-to/deploy.md."""

from __future__ import annotations

import contextlib
import functools
import time
import timeit
from collections.abc import Callable, Iterator

import numpy as np
import zenoh

from bench.machine import Usage, resident_mb
from bench.parts.chain import ROWS, SOURCE, TARGET, TIMES_NS
from bench.parts.robots import FRAMES, RATE_HZ, robots
from bench.report import Report, Trial
from bench.server import LOOKUP, Server, fill, query_client, session
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys
from zenoh_tf_client.requests import lookups as lookup_requests

#: Each waiting lookup gives up after this; none should come near it.
WAIT_S = 120.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000
#: Messages of a robot at a time: one of each of its sensors.
SENSORS = 6


def rows(report: Report) -> None:
    """Lookups a second, many in a call."""
    calls = 2 if report.quick else 40
    with Server() as server, query_client(server.endpoint) as tf:
        fill(tf)
        call = functools.partial(tf.lookup_transforms, TARGET, SOURCE, np.array(TIMES_NS))

        def trial() -> Trial:
            return {"rows_per_s": calls * ROWS / timeit.timeit(call, number=calls)}

        case = {"case": f"lookup_transforms, {ROWS} rows"}
        cell = report.compare(case, {"zenoh-tf": trial}, 15)["zenoh-tf"]
    values = cell.values("rows_per_s")
    report.target("lookup_transforms by query, rows/s", values, ">=", 300_000)


def waiting(report: Report) -> None:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    lookups = 500 if report.quick else 5000
    frames = [f"frame{index}" for index in range(lookups)]
    released_ns, came_ns = np.zeros((2, lookups))

    def on_reply(index: int, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            came_ns[index] = time.monotonic_ns()

    with Server() as server, query_client(server.endpoint) as tf, _waiter(server) as wait:
        tf.set_transforms_xact([_stamped(frame, BEFORE_NS) for frame in frames])
        for index, frame in enumerate(frames):
            wait(frame, functools.partial(on_reply, index))
        _wait_until(lambda: tf.stats()["waiters"] >= lookups)
        with Usage(server.pid) as idle:
            time.sleep(report.seconds(5.0))
        for index, frame in enumerate(frames):
            released_ns[index] = time.monotonic_ns()
            tf.set_transform(_stamped(frame, WANTED_NS))
        _wait_until(came_ns.all)
    p50, p99, worst = map(float, np.percentile((came_ns - released_ns) / 1000, (50, 99, 100)))
    labels = {"case": f"{lookups} waiting lookups, from commit to answer", "system": "zenoh-tf"}
    trial = {"us_p50": p50, "us_p99": p99, "us_worst": worst}
    report.add(labels, trial | {"idle_cpu_percent": 100 * idle.cpu_s[0] / idle.took_s})


def sizing(report: Report) -> None:
    """Memory, and the processor time of the server alone, so that other load matters little."""
    for case, trial in (
        *((f"{count} robots", _robots(report, count)) for count in (1, 10)),
        ("a connected client", _clients(report, 2 if report.quick else 40)),
        ("a waiting lookup", _waiting_lookups(100 if report.quick else 4000)),
        ("a single lookup", _single_lookups(100 if report.quick else 2000)),
    ):
        report.add({"case": case, "system": "server"}, trial)


def _robots(report: Report, count: int) -> Trial:
    with Server() as server, query_client(server.endpoint) as tf:
        empty_mb = resident_mb(server.pid)
        with robots(server.endpoint, count, SENSORS):
            time.sleep(report.seconds(13.0))  # full histories
            with Usage(server.pid, counts=tf.stats) as usage:
                time.sleep(report.seconds(5.0))
            samples, used_mb = tf.stats()["samples"], resident_mb(server.pid)
    puts = max(1, usage.counted["puts"])
    us_per_message = 1e6 * usage.cpu_s[0] / puts
    return {
        "empty_mb": empty_mb,
        "mb": used_mb,
        "bytes_per_sample": 1e6 * (used_mb - empty_mb) / max(1, samples),
        "us_per_message": us_per_message,
        "core_percent": us_per_message / 1e4 * count * SENSORS * RATE_HZ,
        "rate_hz": puts / usage.took_s / count / SENSORS,
        "transforms_per_s": count * RATE_HZ * FRAMES,
    }


def _clients(report: Report, count: int) -> Trial:
    with Server() as server, contextlib.ExitStack() as stack:
        stack.enter_context(query_client(server.endpoint))
        time.sleep(report.seconds(1.0))
        before_mb = resident_mb(server.pid)
        for _ in range(count):
            stack.enter_context(query_client(server.endpoint))
        time.sleep(report.seconds(3.0))
        mb = resident_mb(server.pid) - before_mb
        with Usage(server.pid) as idle:
            time.sleep(report.seconds(8.0))
    return {"mb": mb / count, "core_percent": 100 * idle.cpu_s[0] / idle.took_s / count}


def _waiting_lookups(count: int) -> Trial:
    with Server() as server, query_client(server.endpoint) as tf, _waiter(server) as wait:
        used_mb = []
        for half in (range(count // 2), range(count // 2, count)):  # the first warms up
            for row in half:
                wait(f"f{row}", lambda reply: None)
            _wait_until(functools.partial(lambda stop: tf.stats()["waiters"] >= stop, half.stop))
            used_mb.append(resident_mb(server.pid))
    return {"kb": 1e3 * (used_mb[1] - used_mb[0]) / (count // 2)}


def _single_lookups(count: int) -> Trial:
    with Server() as server, query_client(server.endpoint) as tf, Usage(server.pid) as usage:
        for _ in range(count):
            tf.can_transform("map", "map")
    return {"us_of_processor": 1e6 * usage.cpu_s[0] / count}


@contextlib.contextmanager
def _waiter(server: Server) -> Iterator[Callable[[str, Callable[[zenoh.Reply], None]], None]]:
    """Sends lookups that wait for a later time than any that is there."""
    with session(server.endpoint) as client:
        zid = str(client.zid())

        def wait(source: str, on_reply: Callable[[zenoh.Reply], None]) -> None:
            request = lookup_requests.lookup_transform("map", source, WANTED_NS, WAIT_S)
            client.get(
                LOOKUP,
                on_reply,
                payload=wire.pack(request.body()),
                attachment=zid,
                timeout=2 * WAIT_S,
                consolidation=zenoh.ConsolidationMode.NONE,
            )

        # Lookups of clients that the server knows may wait for long.
        with client.liveliness().declare_token(keys.client("main", zid)):
            time.sleep(0.5)  # the server gets tokens on another thread than queries
            yield wait


def _wait_until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit("lookups that wait were not all accepted, or not all answered")
        time.sleep(0.05)


def _stamped(frame: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", frame, stamp_ns, Transform((1.0, 2.0, 3.0)))
