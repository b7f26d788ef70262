"""Thousands of lookups that wait: what they cost while they do, and how soon they are answered.

As a program, a client process with many of them: ``ENDPOINT FIRST COUNT``. It prints a line when
all are sent, then JSON: for each answer its lookup and when it came (monotonic clock, ns).
"""

from __future__ import annotations

import contextlib
import itertools
import json
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh

from bench.machine import cpu_s
from bench.processes import free_endpoint, request, running
from bench.remote import TREE, open_session
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree, keys, wire
from zenoh_tf_client import TransformClient, requests

PROCESSES = 5
#: Every lookup gives up after this; none should come near it.
TIMEOUT_S = 120.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000


def measure(report: Report) -> None:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    _released(report, lookups=500 if report.quick else 5000)
    _beside(report, waiting=50 if report.quick else 500)


def _stamped(index: int, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", f"frame{index}", stamp_ns, Transform((float(index), 0.0, 0.0)))


def _released(report: Report, lookups: int) -> None:
    endpoint = free_endpoint()
    with (
        running("zenoh_tf_server", "--listen", endpoint, "--log-level", "error") as server,
        TransformClient.connect(endpoint, TREE, timeout_s=30.0) as tf,
        contextlib.ExitStack() as stack,
    ):
        tf.set_transforms_xact([_stamped(index, BEFORE_NS) for index in range(lookups)])
        count = lookups // PROCESSES
        clients = [
            stack.enter_context(running("bench.waiting", endpoint, str(first), str(count)))
            for first in range(0, lookups, count)
        ]
        while tf.stats()["waiters"] < lookups:
            time.sleep(0.1)
        idle_s, before_s = report.seconds(5.0), cpu_s(server.pid)
        time.sleep(idle_s)
        idle_percent = 100 * (cpu_s(server.pid) - before_s) / idle_s

        released_ns = np.zeros(lookups)
        for index in range(lookups):
            released_ns[index] = time.monotonic_ns()
            tf.set_transform(_stamped(index, WANTED_NS))
        answers = np.concatenate([np.array(request(client, "")) for client in clients])
        answers = answers[answers[:, 0].argsort()]
        if [*answers[:, 0]] != [*range(lookups)] or tf.stats()["waiters"] > 0:
            raise SystemExit("a lookup had no answer, or more than one")

    spent_us = (answers[:, 1] - released_ns) / 1000
    names = ("us_p50", "us_p99", "us_worst")
    trial = dict(zip(names, map(float, np.percentile(spent_us, (50, 99, 100))), strict=True))
    trial["idle_cpu_percent"] = idle_percent
    labels = {"case": f"{lookups} waiting lookups, from commit to answer"}
    report.add("waiting", [Cell(labels, "zenoh-tf", trials=[trial])])


def _beside(report: Report, waiting: int) -> None:
    """Sets of a frame that nobody waits for, in a tree where many lookups wait for others."""
    busy, idle = TransformTree(), TransformTree()
    for tree in (busy, idle):
        tree.set_transforms_xact([_stamped(index, BEFORE_NS) for index in range(waiting)])
    threads = [
        threading.Thread(
            target=busy.lookup_transform, args=("map", f"frame{i}", WANTED_NS, TIMEOUT_S)
        )
        for i in range(waiting)
    ]
    for thread in threads:
        thread.start()
    while busy.stats()["waiters"] < waiting:
        time.sleep(0.01)
    sets, stamps_ns = 1000 if report.quick else 20_000, itertools.count()

    def trial(tree: TransformTree) -> Trial:
        stampeds = [_stamped(waiting, next(stamps_ns)) for _ in range(sets)]
        start = time.perf_counter()
        for stamped in stampeds:
            tree.set_transform(stamped)
        return {"us_per_call": 1e6 * (time.perf_counter() - start) / sets}

    labels = {"case": "set_transform beside waiting lookups"}
    cells = [
        Cell(labels, f"{waiting} wait", run=lambda: trial(busy)),
        Cell(labels, "none waits", run=lambda: trial(idle)),
    ]
    report.measure("waiting", cells, report.repetitions(), baseline="none waits")
    busy.set_transforms_xact([_stamped(index, WANTED_NS) for index in range(waiting)])
    for thread in threads:
        thread.join()
    values = ratios(cells[0].values("us_per_call"), cells[1].values("us_per_call"))
    report.check("waiting", [Target("set beside waiting lookups to set", 1.05, values, False)])


def _send(endpoint: str, indexes: range, came: Callable[[int], None]) -> zenoh.Session:
    session = open_session(endpoint)
    for index in indexes:
        lookup = requests.lookup_transform("map", f"frame{index}", WANTED_NS, TIMEOUT_S)

        def on_reply(
            reply: zenoh.Reply, index: int = index, lookup: requests.Request[Any] = lookup
        ) -> None:
            if (sample := reply.ok) is not None:
                lookup.parse(wire.unpack(sample.payload.to_bytes()))
                came(index)

        session.get(
            keys.operation(TREE, "lookup"),
            on_reply,
            payload=wire.pack(lookup.body()),
            timeout=2 * TIMEOUT_S,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
    return session


def main() -> None:
    endpoint, first, count = sys.argv[1:]
    answers: list[tuple[int, int]] = []
    indexes = range(int(first), int(first) + int(count))
    with _send(endpoint, indexes, lambda index: answers.append((index, time.monotonic_ns()))):
        print("sent", flush=True)
        deadline = time.monotonic() + TIMEOUT_S
        while len(answers) < len(indexes) and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(0.5)  # would a second answer come?
        print(json.dumps(answers), flush=True)


if __name__ == "__main__":
    main()
