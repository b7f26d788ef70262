"""Thousands of lookups that wait: what they cost while they do, and how soon they are answered."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np

from bench.figures import Bar, Figure
from bench.machine import ROOT
from bench.processes import free_endpoint, running
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

TREE = "main"
LOOKUPS = 5000
PROCESSES = 5
BATCH = 100
#: Every lookup gives up after this; none should come near it.
TIMEOUT_S = 120.0
IDLE_S = 5.0
BEFORE_NS, WANTED_NS = 1_000_000_000, 2_000_000_000
COMMITS = 20_000


def frame(index: int) -> str:
    return f"frame_{index}"


def measure() -> Iterator[Figure]:
    """From the commit that brings a transform to the answer of the lookup that waits for it."""
    yield from _released("single", "each a query of its own")
    yield from _released("batch", f"in batches of {BATCH}, answered with their last")
    yield _beside()


def _stamped(index: int, stamp_ns: int) -> StampedTransform:
    return StampedTransform("map", frame(index), stamp_ns, Transform((float(index), 0.0, 0.0)))


def _released(kind: str, how: str) -> Iterator[Figure]:
    endpoint = free_endpoint()
    with (
        running("zenoh_tf_server", "--listen", endpoint, "--log-level", "error") as process,
        TransformClient.connect(endpoint, TREE, timeout_s=30.0) as tf,
        contextlib.ExitStack() as stack,
    ):
        tf.set_transforms_xact([_stamped(index, BEFORE_NS) for index in range(LOOKUPS)])
        count = LOOKUPS // PROCESSES
        clients = [
            stack.enter_context(_client(endpoint, kind, process_index * count, count))
            for process_index in range(PROCESSES)
        ]
        for client in clients:
            assert client.stdout is not None and client.stdout.readline() == "sent\n"
        while tf.stats()["waiters"] < LOOKUPS:
            time.sleep(0.1)

        print(f"{LOOKUPS} lookups waiting from {PROCESSES} processes, {how}")
        spent_s = _cpu_s(process.pid)
        time.sleep(IDLE_S)
        idle = 100 * (_cpu_s(process.pid) - spent_s) / IDLE_S
        yield Figure(f"server's processor while all wait ({kind})", "%", [idle])

        committed_ns = []
        for index in range(LOOKUPS):
            committed_ns.append(time.monotonic_ns())
            tf.set_transform(_stamped(index, WANTED_NS))
        answered: dict[int, list[int]] = {}
        for client in clients:
            assert client.stdout is not None
            times = json.loads(client.stdout.readline())
            answered |= {int(index): when for index, when in times.items()}
        assert sorted(answered) == list(range(LOOKUPS))
        twice = sum(len(when) > 1 for when in answered.values())
        never = sum(not when for when in answered.values())
        assert (never, twice, tf.stats()["waiters"]) == (0, 0, 0), (never, twice)

    released_ns = np.array(committed_ns)
    if kind == "batch":  # a batch is released by the last commit that it waits for
        released_ns = released_ns.reshape(-1, BATCH).max(axis=1).repeat(BATCH)
    came_ns = np.array([answered[index][0] for index in range(LOOKUPS)])
    delays_us = (came_ns - released_ns) / 1000
    for share in (50, 99, 100):
        name = "worst" if share == 100 else f"p{share}"
        value = float(np.percentile(delays_us, share))
        yield Figure(f"commit sent to answer, {name} ({kind})", "us", [value])


def _beside() -> Figure:
    """Sets of a frame that nobody waits for, by turns in a tree where many wait for others."""
    trees = [TransformTree(), TransformTree()]
    waiting = trees[1]
    for tree in trees:
        tree.set_transforms_xact([_stamped(index, BEFORE_NS) for index in range(500)])
    threads = [
        threading.Thread(target=waiting.lookup_transform, args=("map", frame(i), WANTED_NS, 60.0))
        for i in range(500)
    ]
    for thread in threads:
        thread.start()
    while waiting.stats()["waiters"] < len(threads):
        time.sleep(0.01)
    spent: list[list[float]] = [[], []]
    for turn in range(8):
        for tree, values in zip(trees, spent, strict=True):
            stamped = [_stamped(LOOKUPS, turn * COMMITS + i) for i in range(COMMITS)]
            start = time.perf_counter()
            for one in stamped:
                tree.set_transform(one)
            if turn:
                values.append(1e6 * (time.perf_counter() - start) / COMMITS)
    waiting.set_transforms_xact([_stamped(index, WANTED_NS) for index in range(500)])
    for thread in threads:
        thread.join()
    about = "of a frame that nobody waits for, while 500 wait for others; against a tree without"
    return Figure("set_transform", "us", spent[1], about, spent[0], Bar(1.05, ratio=True))


def _cpu_s(pid: int) -> float:
    with open(f"/proc/{pid}/stat") as stat:
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def _client(endpoint: str, kind: str, first: int, count: int) -> Iterator[subprocess.Popen[str]]:
    arguments = (endpoint, kind, str(first), str(count), str(WANTED_NS))
    process = subprocess.Popen(
        [sys.executable, "-m", "bench.waiting_client", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        yield process
    finally:
        process.wait(30)
