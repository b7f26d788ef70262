"""What mirrors cost, and how late they are, beside robots that publish: all of a tree, three of its
frames, and a thinned stream."""

from __future__ import annotations

import functools
import time

from bench.machine import cpu_s
from bench.mirror_process import SOURCE
from bench.process import Process, module, server
from bench.report import Cell, Report, Target, Trial
from bench.robots import FRAMES, RATE_HZ, robots
from zenoh_tf_client import TransformClient

#: What each mirror has; the keys are those of `mirror_process`.
KINDS = ("none", "full", "interest", "interest at once", "thinned")
SLICE_S = 3.0
#: Until the load runs evenly, and the mirror has its first copy.
SETTLE_S = 1.0


def measure(report: Report) -> None:
    """Costs beside ten robots, then one mirror beside more and more robots."""
    _costs(report, 10)
    for count in (30, 100) if not report.quick else ():
        _lag(report, count)


def _costs(report: Report, count: int) -> None:
    with server() as (process, endpoint), robots(endpoint, count):
        labels = {"case": f"{count} robots of {FRAMES} frames at {RATE_HZ} Hz"}
        cells = {
            kind: Cell(labels, kind, run=functools.partial(_trial, report, process, endpoint, kind))
            for kind in KINDS
        }
        _wait_for_robots(endpoint)
        time.sleep(report.seconds(12))  # full histories
        report.measure(list(cells.values()), report.repetitions(7))
    targets = []
    for metric in ("server_share", "client_share", "bytes_per_s"):
        none, full, part = (cells[kind].values(metric) for kind in ("none", "full", "interest"))
        values = [
            (mine - base) / (whole - base)
            for mine, base, whole in zip(part, none, full, strict=True)
            if whole > base
        ]
        targets.append(Target(f"three frames to all, {metric}", 0.1, values, False))
    report.check(targets)


def _lag(report: Report, count: int) -> None:
    """One mirror of everything: its age, and what is lost on the way."""
    with server() as (process, endpoint), robots(endpoint, count):
        _wait_for_robots(endpoint)
        time.sleep(report.seconds(5))
        labels = {"case": f"one mirror of everything, {count} robots"}
        run = functools.partial(_trial, report, process, endpoint, "full")
        report.measure([Cell(labels, "full", run=run)], report.repetitions(3))


def _wait_for_robots(endpoint: str) -> None:
    with TransformClient.connect(endpoint, reads="query") as tf:
        tf.lookup_transform("map", SOURCE, timeout_s=20.0)


def _trial(report: Report, process: Process, endpoint: str, kind: str) -> Trial:
    """Shares of a processor, and bytes of the streams, while one mirror of a kind is there."""
    with TransformClient.connect(endpoint, reads="query") as tf:
        if kind == "none":
            time.sleep(report.seconds(SETTLE_S))
            return _watch(report, process.pid, tf, None)
        with module("bench.mirror_process", endpoint, kind) as mirror:
            time.sleep(report.seconds(SETTLE_S))
            return _watch(report, process.pid, tf, mirror)


def _watch(report: Report, pid: int, tf: TransformClient, mirror: Process | None) -> Trial:
    before, begun_s = tf.stats(), time.perf_counter()
    server_s, mirror_s = cpu_s(pid), cpu_s(mirror.pid) if mirror else 0.0
    time.sleep(report.seconds(SLICE_S))
    server_s = cpu_s(pid) - server_s
    mirror_s = cpu_s(mirror.pid) - mirror_s if mirror else 0.0
    took_s, now = time.perf_counter() - begun_s, tf.stats()
    change = {name: (now[name] - before[name]) / took_s for name in now}
    seen: Trial = mirror.ask() if mirror else {}
    return {
        "server_share": server_s / took_s,
        "client_share": mirror_s / took_s,
        "bytes_per_s": change["stream_message_bytes"] + change["interest_message_bytes"],
        "messages_per_s": change["stream_messages"] + change["interest_messages"],
        "transforms_per_s": change["put_transforms"],
        "dropped_puts_per_s": change["dropped_by_queue"],
        "stream_gaps": now["stream_gaps"] - before["stream_gaps"],
    } | seen
