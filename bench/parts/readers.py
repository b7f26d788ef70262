"""Processes that read a server's memory at full rate, beside 1,000 commits a second."""

from __future__ import annotations

import contextlib
import functools
import json
import threading
import time

from bench.machine import Usage
from bench.parts.chain import END_NS, SOURCE, TARGET
from bench.process import Process, serve
from bench.report import Cell, Report, Trial
from bench.server import Server, fill, shared_client
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

OWN, SHARED = "a tree of its own", "the server's memory"
COMMITS_PER_S = 1000


def measure(report: Report) -> None:
    """Lookups a second of all processes, and the cores that the server uses."""
    seconds, ending = report.seconds(0.5), threading.Event()
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(Server())
        tf = stack.enter_context(shared_client(server.endpoint))
        fill(tf)
        readers = {
            system: [stack.enter_context(Process.of(read, *where)) for _ in range(4)]
            for system, where in ((OWN, ()), (SHARED, (server.endpoint,)))
        }
        writer = threading.Thread(target=_write, args=(tf, ending))
        writer.start()
        stack.callback(writer.join)
        stack.callback(ending.set)
        trial = functools.partial(_trial, server.pid, seconds)
        cells = {(0, "none"): Cell({"reader processes": 0, "system": "none"}, lambda: trial([]))}
        for count in (1, 2, 4):
            for system, processes in readers.items():
                labels = {"reader processes": count, "system": system}
                run = functools.partial(trial, processes[:count])
                cells[count, system] = Cell(labels, run)
        report.measure(list(cells.values()))
    for count in (1, 2, 4):
        values = cells[count, SHARED].over(cells[count, OWN], "lookups_per_s")
        report.target(f"{count} processes, server's memory to own tree", values, ">=", 1 / 1.5)


def _trial(pid: int, seconds: float, readers: list[Process]) -> Trial:
    with Usage(pid) as usage:
        for reader in readers:
            reader.send(seconds)
        rates = [json.loads(reader.read_line()) for reader in readers]
        if not readers:
            time.sleep(seconds)
    cores = {"server_cores": usage.cpu_s[0] / usage.took_s}
    return cores | ({"lookups_per_s": sum(rates)} if rates else {})


def _write(tf: TransformClient, ending: threading.Event) -> None:
    """Commits two of the links that are read, together, at the rate."""
    next_s, stamp_ns = time.monotonic(), END_NS
    links, pose = (("map", "odom"), ("odom", "base_link")), Transform((1.0, 2.0, 3.0))
    while not ending.is_set():
        stamp_ns += 1_000_000_000 // COMMITS_PER_S
        tf.set_transforms_xact([StampedTransform(*link, stamp_ns, pose) for link in links])
        next_s += 1 / COMMITS_PER_S
        time.sleep(max(0.0, next_s - time.monotonic()))


def read(*endpoint: str) -> None:
    """Reads the memory of the server there, or a tree of its own. Answers a number of seconds with
    its lookups a second meanwhile."""
    tree: TransformTree | TransformClient
    if endpoint:
        tree = shared_client(*endpoint)
    else:
        fill(tree := TransformTree())

    def lookups_per_s(seconds: str) -> float:
        calls, begun_s = 0, time.perf_counter()
        while time.perf_counter() - begun_s < float(seconds):
            for _ in range(500):
                tree.lookup_latest_transform_xact(TARGET, SOURCE)
            calls += 500
        return calls / (time.perf_counter() - begun_s)

    serve(lookups_per_s)
