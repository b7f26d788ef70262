"""What mirrors cost, and how late they are, beside robots that publish: all of a tree, three of its
frames, and a thinned stream."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.machine import Usage
from bench.parts.robots import robots
from bench.process import Process, serve
from bench.report import Cell, Report, Trial
from bench.server import Server, query_client
from zenoh_tf_client import TransformClient

#: The frames of the interest are three: the parent of the pair's frames, and these.
TARGET, SOURCE = "robot3/frame10", "robot3/frame11"
MIRRORS: dict[str, dict[str, Any]] = {
    "full": {},
    "interest": {"pairs": [(TARGET, SOURCE)]},
    "interest at once": {"pairs": [(TARGET, SOURCE)], "max_delay_s": 0},
    "thinned": {"max_rate_hz": 10},
}


def measure(report: Report) -> None:
    """Costs beside ten robots, then one mirror beside more and more robots."""
    cells = _beside(report, 10, ("none", *MIRRORS), 7)
    for metric in ("server_share", "client_share", "mb_per_s"):
        none, whole, part = (
            cells[system].values(metric) for system in ("none", "full", "interest")
        )
        costs = [
            (mine - base) / (full - base)
            for mine, base, full in zip(part, none, whole, strict=True)
            if full > base
        ]
        report.target(f"three frames to all, {metric}", costs, "<=", 0.1)
    for count in (30, 100) if not report.quick else ():
        _beside(report, count, ("full",), 3)


def _beside(
    report: Report, count: int, systems: Sequence[str], repetitions: int
) -> dict[str, Cell]:
    with (
        Server() as server,
        robots(server.endpoint, count),
        query_client(server.endpoint) as tf,
    ):
        tf.lookup_transform("map", SOURCE, timeout_s=20.0)
        time.sleep(report.seconds(12 if count == 10 else 5))  # full histories
        runs = {each: functools.partial(_trial, report, server, tf, each) for each in systems}
        return report.compare({"case": f"{count} robots"}, runs, repetitions)


def _trial(report: Report, server: Server, tf: TransformClient, system: str) -> Trial:
    """Shares of a processor, and what the streams carry, while there is such a mirror."""
    with contextlib.ExitStack() as stack:
        mirror = None
        if system != "none":
            mirror = stack.enter_context(Process.of(run_mirror, server.endpoint, system))
        time.sleep(report.seconds(1.0))  # until the mirror has its first copy
        pids = [process.pid for process in (server, mirror) if process]
        with Usage(*pids, counts=tf.stats) as usage:
            time.sleep(report.seconds(3.0))
        seen: Trial = mirror.ask() if mirror else {}
    change = {name: count / usage.took_s for name, count in usage.counted.items()}
    server_share, client_share = [s / usage.took_s for s in (*usage.cpu_s, 0.0)[:2]]
    sent_bytes = change["stream_message_bytes"] + change["interest_message_bytes"]
    transforms = max(1.0, change["put_transforms"])
    return {
        "server_share": server_share,
        "client_share": client_share,
        "mb_per_s": sent_bytes / 1e6,
        "messages_per_s": change["stream_messages"] + change["interest_messages"],
        "transforms_per_s": transforms,
        "bytes_per_transform": sent_bytes / transforms,
        "client_us_per_transform": 1e6 * client_share / transforms,
        "dropped_puts_per_s": change["dropped_by_queue"],
        "stream_gaps": usage.counted["stream_gaps"],
    } | seen


def run_mirror(endpoint: str, system: str) -> None:
    """Samples its age and that of a pose that it reads; answers with their medians and tails."""
    with query_client(endpoint) as tf, tf.mirror(**MIRRORS[system]) as mirror:
        ages_ms: dict[str, list[float]] = {"age": [], "pose_age": []}

        def sample() -> None:
            while True:
                ages_ms["age"].append(1e3 * mirror.age_s)
                stamp_ns = mirror.lookup_latest_transform(TARGET, SOURCE).stamp_ns
                ages_ms["pose_age"].append((time.monotonic_ns() - stamp_ns) / 1e6)
                time.sleep(0.1)

        def answer(_: str) -> Trial:
            found: Trial = {"frames": len(mirror.frames())}
            for name, values in ages_ms.items():
                median, tail = map(float, np.percentile(values, (50, 99)))
                found |= {f"{name}_ms": median, f"{name}_p99_ms": tail}
            return found

        mirror.lookup_latest_transform(TARGET, SOURCE)
        threading.Thread(target=sample, daemon=True).start()
        serve(answer)
