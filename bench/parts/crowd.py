"""What the puts of many robots cost a server, and how old its data is, beside a bare subscriber in
Python that only receives them; and beside a program that keeps a core busy. Then a site that
follows the trees of as many robots."""

from __future__ import annotations

import functools
import random
import sys
import time

import numpy as np
import zenoh

from bench.machine import Usage
from bench.parts.robots import FRAMES, RATE_HZ, SERVED, robot_servers, robots
from bench.process import Process, serve
from bench.report import Cell, Report, Trial
from bench.server import Server, free_endpoint, shared_client
from zenoh_tf._net import zenoh_config
from zenoh_tf_client import TransformClient

#: Robots, and the rate of each; all send 60 frames in a message.
CROWDS = ((10, RATE_HZ), (30, RATE_HZ), (100, RATE_HZ), (1000, 4))
FEDERATED = (1000, 10)
STARVED = (30, 100)
SAMPLES_HZ = 200
BUSY = "while True: pass"


def measure(report: Report) -> None:
    """Each crowd beside an idle machine, then some beside a busy core."""
    for count, rate_hz in CROWDS[: 1 if report.quick else None]:
        case = {"case": f"{count} robots at {rate_hz} Hz", "busy cores": 0}
        runs = {
            "zenoh-tf": functools.partial(_server, report, count, rate_hz),
            "bare subscriber": functools.partial(_subscriber, report, count, rate_hz),
        }
        cells = report.compare(case, runs, 3)
        values = cells["zenoh-tf"].over(cells["bare subscriber"], "us_per_put")
        report.target(f"{case['case']}, processor time to a bare one's", values, "<=", 1.8)
        if count == 1000:
            _check_site(report, case["case"], cells["zenoh-tf"])
    count, rate_hz = FEDERATED if not report.quick else (20, 10)
    case = {"case": f"{count} robots' trees at {rate_hz} Hz", "busy cores": 0}
    run = functools.partial(_site, report, count, rate_hz)
    _check_site(report, case["case"], report.compare(case, {"site": run}, 3)["site"])
    for count in STARVED if not report.quick else ():
        with Process(sys.executable, "-c", BUSY, wait=False):
            case = {"case": f"{count} robots at {RATE_HZ} Hz", "busy cores": 1}
            run = functools.partial(_server, report, count, RATE_HZ)
            cell = report.compare(case, {"zenoh-tf": run}, 3)["zenoh-tf"]
        share, age_ms = (0.95, 20) if count == 30 else (0.6, 250)
        name = f"{count} robots beside a busy core"
        report.target(f"{name}, share stored", cell.values("stored"), ">=", share)
        report.target(f"{name}, age p50, ms", cell.values("age_p50_ms"), "<=", age_ms)


def _check_site(report: Report, case: object, cell: Cell) -> None:
    """The targets of a thousand robots."""
    report.target(f"{case}, age p99, ms", cell.values("age_p99_ms"), "<=", 300)
    report.target(f"{case}, cores", cell.values("cores"), "<=", 1.2)


def _server(report: Report, count: int, rate_hz: float) -> Trial:
    with (
        Server() as server,
        robots(server.endpoint, count, 1, rate_hz, count),
        shared_client(server.endpoint) as tf,
    ):
        return _serve(report, server, tf, count, count * rate_hz * FRAMES, "robot{}/frame59")


def _site(report: Report, count: int, rate_hz: float) -> Trial:
    """Of robots whose servers share a few sessions, as their connections are not measured here."""
    link = f"robots/*,frames={':'.join(('map', *SERVED))},rate={rate_hz:g}"
    with (
        Server("--tree", "site", "--mirror-shared", "map", "--mirror-of", link) as site,
        robot_servers(site.endpoint, count, rate_hz, 10),
        TransformClient.connect(site.endpoint, "site") as tf,
    ):
        return _serve(report, site, tf, count, count * rate_hz * len(SERVED), "r{}/camera")


def _serve(
    report: Report, server: Server, tf: TransformClient, count: int, per_s: float, frame: str
) -> Trial:
    """The figures of a server that receives so many transforms a second of so many robots, each
    with a frame that is called so."""
    for number in range(count):
        tf.lookup_transform("map", frame.format(number), timeout_s=60.0)
    time.sleep(report.seconds(5.0))
    with Usage(server.pid, counts=tf.stats) as usage:
        ages_ms = _ages_ms(tf, count, frame, report.seconds(10.0))
    p50, p99 = map(float, np.percentile(ages_ms, (50, 99)))
    return _costs(usage) | {
        "stored": usage.counted["put_transforms"] / (per_s * usage.took_s),
        "age_p50_ms": p50,
        "age_p99_ms": p99,
        "dropped_as_stale": usage.counted["dropped_as_stale"],
        "dropped_by_queue": usage.counted["dropped_by_queue"],
    }


def _costs(usage: Usage) -> Trial:
    spent_s = usage.cpu_s[0]
    us_per_put = 1e6 * spent_s / max(1, usage.counted["puts"])
    return {"us_per_put": us_per_put, "cores": spent_s / usage.took_s}


def _ages_ms(tf: TransformClient, count: int, frame: str, for_s: float) -> list[float]:
    """How old the newest pose of one robot after another is."""
    found: list[float] = []
    end_s = time.monotonic() + for_s
    while time.monotonic() < end_s:
        robot = frame.format(random.randrange(count))
        stamp_ns = tf.lookup_latest_transform("map", robot).stamp_ns
        found.append((time.monotonic_ns() - stamp_ns) / 1e6)
        time.sleep(1 / SAMPLES_HZ)
    return found


def _subscriber(report: Report, count: int, rate_hz: float) -> Trial:
    endpoint = free_endpoint()
    with Process.of(subscribe, endpoint) as bare, robots(endpoint, count, 1, rate_hz, count):
        time.sleep(report.seconds(5.0))
        with Usage(bare.pid, counts=bare.ask) as usage:
            time.sleep(report.seconds(10.0))
    return _costs(usage)


def subscribe(endpoint: str) -> None:
    """The bare subscriber: answers with the messages received."""
    received = 0

    def on_put(sample: zenoh.Sample) -> None:
        nonlocal received
        received += len(sample.payload.to_bytes()) > 0

    with zenoh.open(zenoh_config.router([endpoint])) as session:
        session.declare_subscriber("**", on_put)
        serve(lambda _: {"puts": received})
