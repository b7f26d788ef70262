"""Thousands of lookups that wait: what they cost while they do, and how soon they are answered."""

from __future__ import annotations

import time

import numpy as np
import zenoh

from bench.machine import cpu_s
from bench.processes import free_endpoint, running
from bench.remote import TREE
from bench.report import Cell, Report
from zenoh_tf import StampedTransform, Transform, keys, wire, zenoh_config
from zenoh_tf_client import TransformClient, requests

#: Every lookup gives up after this; none should come near it.
TIMEOUT_S = 120.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000


def measure(report: Report) -> None:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    lookups, endpoint = 500 if report.quick else 5000, free_endpoint()
    frames = [f"frame{index}" for index in range(lookups)]
    came_ns = np.zeros(lookups)
    with (
        running("zenoh_tf_server", "--listen", endpoint, "--log-level", "error") as server,
        TransformClient.connect(endpoint, TREE, timeout_s=30.0) as tf,
        zenoh.open(zenoh_config.client([endpoint], 5.0)) as session,
    ):
        tf.set_transforms_xact([_stamped(frame, BEFORE_NS) for frame in frames])
        for index, frame in enumerate(frames):

            def on_reply(reply: zenoh.Reply, index: int = index) -> None:
                if reply.ok is not None:
                    came_ns[index] = time.monotonic_ns()

            lookup = requests.lookup_transform("map", frame, WANTED_NS, TIMEOUT_S)
            session.get(
                keys.operation(TREE, "lookup"),
                on_reply,
                payload=wire.pack(lookup.body()),
                timeout=2 * TIMEOUT_S,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        while tf.stats()["waiters"] < lookups:
            time.sleep(0.1)
        idle_s, before_s = report.seconds(5.0), cpu_s(server.pid)
        time.sleep(idle_s)
        idle_percent = 100 * (cpu_s(server.pid) - before_s) / idle_s
        released_ns = np.zeros(lookups)
        for index, frame in enumerate(frames):
            released_ns[index] = time.monotonic_ns()
            tf.set_transform(_stamped(frame, WANTED_NS))
        deadline = time.monotonic() + TIMEOUT_S
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
