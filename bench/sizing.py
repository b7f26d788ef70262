"""What a server needs of its host, for docs/how-to/deploy.md: its memory, and its processor time,
so that other load matters little."""

from __future__ import annotations

import time
from contextlib import ExitStack

from bench.machine import cpu_s, resident_mb
from bench.process import server
from bench.queries import wait, wait_for_waiters, waiting_client
from bench.report import Cell, Report, Trial
from bench.robots import FRAMES, RATE_HZ, robots
from zenoh_tf_client import TransformClient

#: Messages of a robot at a time: one of each of its sensors.
SENSORS = 6
#: Long enough for full histories, and then for the measurement.
FILL_S, MEASURE_S = 13.0, 5.0
CONNECTIONS = 40
WAITING = 4000
LOOKUPS = 2000


def measure(report: Report) -> None:
    for count in (1, 10):
        _keep(report, f"{count} robots", _robots(report, count))
    _keep(report, "a connected client", _clients(report))
    for case, trial in _lookups(report).items():
        _keep(report, case, trial)


def _keep(report: Report, case: str, trial: Trial) -> None:
    report.measure([Cell({"case": case}, "server", trials=[trial])], 0)


def _robots(report: Report, count: int) -> Trial:
    with (
        server() as (process, endpoint),
        TransformClient.connect(endpoint, timeout_s=20.0, reads="query") as tf,
    ):
        empty_mb = resident_mb(process.pid)
        with robots(endpoint, count, SENSORS):
            time.sleep(report.seconds(FILL_S))
            first_s, puts, begun_s = cpu_s(process.pid), tf.stats()["puts"], time.monotonic()
            time.sleep(report.seconds(MEASURE_S))
            spent_s, stats = cpu_s(process.pid) - first_s, tf.stats()
            puts, took_s = max(1, stats["puts"] - puts), time.monotonic() - begun_s
            used_mb = resident_mb(process.pid)
    each_s, wanted_per_s = spent_s / puts, count * SENSORS * RATE_HZ
    return {
        "empty_mb": empty_mb,
        "mb": used_mb,
        "bytes_per_sample": 1e6 * (used_mb - empty_mb) / max(1, stats["samples"]),
        "us_per_message": 1e6 * each_s,
        "core_percent": 100 * each_s * wanted_per_s,
        "rate_hz": puts / took_s / count / SENSORS,
        "transforms_per_s": wanted_per_s * FRAMES / SENSORS,
    }


def _clients(report: Report) -> Trial:
    count = 2 if report.quick else CONNECTIONS
    with server() as (process, endpoint), ExitStack() as stack:
        stack.enter_context(_client(endpoint))
        time.sleep(report.seconds(1.0))
        before_mb = resident_mb(process.pid)
        for _ in range(count):
            stack.enter_context(_client(endpoint))
        time.sleep(report.seconds(3.0))
        mb, begun_s = resident_mb(process.pid) - before_mb, cpu_s(process.pid)
        time.sleep(idle_s := report.seconds(8.0))
        spent_s = cpu_s(process.pid) - begun_s
    return {"mb": mb / count, "core_percent": 100 * spent_s / idle_s / count}


def _client(endpoint: str) -> TransformClient:
    return TransformClient.connect(endpoint, timeout_s=20.0, reads="query")


def _lookups(report: Report) -> dict[str, Trial]:
    waiting, lookups = (100, 100) if report.quick else (WAITING, LOOKUPS)
    with (
        server() as (process, endpoint),
        _client(endpoint) as tf,
        waiting_client(endpoint) as session,
    ):
        used_mb = []
        for half in (range(waiting // 2), range(waiting // 2, waiting)):  # the first warms up
            for row in half:
                wait(session, "map", f"f{row}", lambda reply: None)
            wait_for_waiters(tf, half.stop)
            used_mb.append(resident_mb(process.pid))
        kb = 1e3 * (used_mb[1] - used_mb[0]) / (waiting // 2)
        begun_s = cpu_s(process.pid)
        for _ in range(lookups):
            tf.can_transform("map", "map")
        us = 1e6 * (cpu_s(process.pid) - begun_s) / lookups
    return {"a waiting lookup": {"kb": kb}, "a single lookup": {"us_of_processor": us}}
