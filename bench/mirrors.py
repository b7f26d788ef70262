"""What mirrors cost, and how late they are, beside robots that publish: all of a tree, three of its
frames, and a thinned stream."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
import time

from bench.machine import ROOT, cpu_s
from bench.mirror_load import FRAMES, RATE_HZ
from bench.remote import SERVER, running
from bench.report import Cell, Report, Target, Trial
from zenoh_tf_client import TransformClient

#: What each mirror has; the keys are those of `mirror_process`.
KINDS = ("none", "full", "interest", "interest at once", "thinned")
SLICE_S = 6.0
#: Until the load runs evenly, and the mirror has its first copy.
SETTLE_S = 1.0


def measure(report: Report) -> None:
    """Costs beside ten robots, then one mirror beside more and more robots."""
    _costs(report, 10)
    for robots in (10, 30, 100):
        _lag(report, robots)


def _costs(report: Report, robots: int) -> None:
    with running(*SERVER) as (server, endpoint), _load(endpoint, robots):
        labels = {"case": f"{robots} robots of {FRAMES} frames at {RATE_HZ} Hz"}
        cells = {
            kind: Cell(labels, kind, run=functools.partial(_trial, report, server, endpoint, kind))
            for kind in KINDS
        }
        time.sleep(report.seconds(12))  # full histories
        report.measure("mirrors", list(cells.values()), report.repetitions(9), baseline="none")
    targets = []
    for metric in ("server_share", "client_share", "bytes_per_s"):
        none, full, part = (cells[kind].values(metric) for kind in ("none", "full", "interest"))
        values = [
            (mine - base) / (whole - base)
            for mine, base, whole in zip(part, none, full, strict=True)
            if whole > base
        ]
        targets.append(Target(f"three frames to all, {metric}", 0.1, values, False))
    report.check("mirrors", targets)


def _trial(report: Report, server: subprocess.Popen[str], endpoint: str, kind: str) -> Trial:
    """Shares of a processor, and bytes of the streams, while one mirror of a kind is there."""
    with TransformClient.connect(endpoint, reads="query") as tf:
        if kind == "none":
            time.sleep(SETTLE_S)
            return _watch(report, server.pid, tf, None)
        with _mirror(endpoint, kind) as mirror:
            time.sleep(SETTLE_S)
            found = _watch(report, server.pid, tf, mirror.pid)
            return found | _told(mirror)


def _watch(report: Report, server: int, tf: TransformClient, mirror: int | None) -> Trial:
    before, begin_s = tf.stats(), time.perf_counter()
    server_s, mirror_s = cpu_s(server), cpu_s(mirror) if mirror else 0.0
    time.sleep(report.seconds(SLICE_S))
    server_s = cpu_s(server) - server_s
    mirror_s = cpu_s(mirror) - mirror_s if mirror else 0.0
    took_s, now = time.perf_counter() - begin_s, tf.stats()
    change = {name: (now[name] - before[name]) / took_s for name in now}
    return {
        "server_share": server_s / took_s,
        "client_share": mirror_s / took_s,
        "bytes_per_s": change["stream_message_bytes"] + change["interest_message_bytes"],
        "messages_per_s": change["stream_messages"] + change["interest_messages"],
        "transforms_per_s": change["put_transforms"],
    }


def _lag(report: Report, robots: int) -> None:
    """One mirror of everything: its age, and what is lost on the way."""
    with running(*SERVER) as (server, endpoint), _load(endpoint, robots) as load:
        time.sleep(report.seconds(6))
        labels = {"case": f"one mirror of everything, {robots} robots"}
        begin_s, load_s = time.perf_counter(), cpu_s(load.pid)
        run = functools.partial(_trial, report, server, endpoint, "full")
        cell = Cell(labels, "full", run=run)
        report.measure("mirrors", [cell], report.repetitions(3), baseline="none")
        share = (cpu_s(load.pid) - load_s) / (time.perf_counter() - begin_s)
        with TransformClient.connect(endpoint, reads="query") as tf:
            stats = tf.stats()
        wanted = robots * FRAMES * RATE_HZ
        print(
            f"{'of these robots':<28} {'transforms wanted per s':<32} {wanted:,}; the load's own "
            f"share {share:.2f}; puts dropped {stats['dropped_by_queue']:,}, gaps of the stream "
            f"{stats['stream_gaps']:,}",
            flush=True,
        )


def _load(endpoint: str, robots: int) -> subprocess.Popen[str]:
    return _Process("bench.mirror_load", endpoint, str(robots))


def _mirror(endpoint: str, kind: str) -> subprocess.Popen[str]:
    return _Process("bench.mirror_process", endpoint, kind)


class _Process(subprocess.Popen[str]):
    """A Python module that says when it has begun, and ends when its stdin does."""

    def __init__(self, module: str, *arguments: str) -> None:
        command = [sys.executable, "-m", module, *arguments]
        pipe = subprocess.PIPE
        super().__init__(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        assert self.stdout is not None
        if not self.stdout.readline():
            raise SystemExit(f"{module} did not start")

    def __exit__(self, *error: object) -> None:
        self.terminate()
        super().__exit__(*error)  # type: ignore[arg-type]


def _told(mirror: subprocess.Popen[str]) -> Trial:
    """What the mirror has seen of itself since the last time."""
    assert mirror.stdin is not None
    assert mirror.stdout is not None
    mirror.stdin.write("\n")
    mirror.stdin.flush()
    found: Trial = json.loads(mirror.stdout.readline())
    return found
