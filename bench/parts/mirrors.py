"""What mirrors cost, and how late they are, beside robots that publish: all of a tree, three of its
frames, and a thinned stream.

``python -m bench.parts.mirrors ENDPOINT SYSTEM`` is one: it samples its age, and the age of a pose
that it reads, and answers with their medians and tails.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.machine import cpu_s
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
            mirror = stack.enter_context(Process.of(__name__, server.endpoint, system))
        time.sleep(report.seconds(1.0))  # until the mirror has its first copy
        before, begun_s = tf.stats(), time.perf_counter()
        server_s, mirror_s = cpu_s(server.pid), cpu_s(mirror.pid) if mirror else 0.0
        time.sleep(report.seconds(3.0))
        server_s = cpu_s(server.pid) - server_s
        mirror_s = cpu_s(mirror.pid) - mirror_s if mirror else 0.0
        took_s, now = time.perf_counter() - begun_s, tf.stats()
        seen: Trial = mirror.ask() if mirror else {}
    change = {name: (now[name] - before[name]) / took_s for name in now}
    sent_bytes = change["stream_message_bytes"] + change["interest_message_bytes"]
    transforms, client_share = max(1.0, change["put_transforms"]), mirror_s / took_s
    return {
        "server_share": server_s / took_s,
        "client_share": client_share,
        "mb_per_s": sent_bytes / 1e6,
        "messages_per_s": change["stream_messages"] + change["interest_messages"],
        "transforms_per_s": transforms,
        "bytes_per_transform": sent_bytes / transforms,
        "client_us_per_transform": 1e6 * client_share / transforms,
        "dropped_puts_per_s": change["dropped_by_queue"],
        "stream_gaps": now["stream_gaps"] - before["stream_gaps"],
    } | seen


def main() -> None:
    endpoint, system = sys.argv[1:]
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


if __name__ == "__main__":
    main()
