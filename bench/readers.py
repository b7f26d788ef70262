"""Processes that read a server's memory at full rate, beside 1,000 commits a second.

``python -m bench.readers [ENDPOINT]`` is one of them; without an endpoint it reads a tree of its
own. Each line on stdin, a number of seconds, is answered with its lookups a second meanwhile.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
import time
from typing import Final

from bench.machine import cpu_s
from bench.process import Process, module, server
from bench.python_system import END_NS, SOURCE, TARGET, history
from bench.queries import fill
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf_client import TransformClient

READERS: Final = (1, 2, 4)
COMMITS_PER_S: Final = 1000
SLICE_S: Final = 0.5
OWN, SHARED = "a tree of its own", "the server's memory"
_CALLS: Final = 500
#: Links of the chain that is read, which each commit writes.
_LINKS: Final = (("map", "odom"), ("odom", "base_link"))


def measure(report: Report) -> None:
    """Lookups a second of all processes, and the cores that the server uses."""
    with server() as (process, endpoint), TransformClient.connect(endpoint) as tf:
        fill(tf)
        ending = threading.Event()
        writer = threading.Thread(target=_write, args=(tf, ending))
        with contextlib.ExitStack() as stack:
            readers = {
                way: [stack.enter_context(module("bench.readers", *where)) for _ in range(4)]
                for way, where in ((OWN, ()), (SHARED, (endpoint,)))
            }
            writer.start()
            try:
                _compare(report, process.pid, readers)
            finally:
                ending.set()
                writer.join()


def _compare(report: Report, pid: int, readers: dict[str, list[Process]]) -> None:
    trial = functools.partial(_trial, pid, report.seconds(SLICE_S))
    cells = {
        (count, way): Cell(
            {"reader processes": count}, way, run=functools.partial(trial, processes[:count])
        )
        for count in READERS
        for way, processes in readers.items()
    }
    idle = Cell({"reader processes": 0}, "none", run=functools.partial(trial, []))
    report.measure([idle, *cells.values()], report.repetitions())
    for count in READERS:
        ours, theirs = (cells[count, way].values("lookups_per_s") for way in (SHARED, OWN))
        title = f"{count} processes, server's memory to own tree"
        report.check([Target(title, 1 / 1.5, ratios(ours, theirs))])


def _trial(pid: int, seconds: float, readers: list[Process]) -> Trial:
    before_s, begun_s = cpu_s(pid), time.perf_counter()
    for reader in readers:
        reader.tell(str(seconds))
    rates = [float(reader.read_line()) for reader in readers]
    if not readers:
        time.sleep(seconds)
    cores = (cpu_s(pid) - before_s) / (time.perf_counter() - begun_s)
    return {"server_cores": cores} | ({"lookups_per_s": sum(rates)} if rates else {})


def _write(tf: TransformClient, ending: threading.Event) -> None:
    """Commits two of the links that are read, together, at the rate."""
    next_s, stamp_ns = time.monotonic(), END_NS
    pose = Transform((1.0, 2.0, 3.0))
    while not ending.is_set():
        stamp_ns += 1_000_000_000 // COMMITS_PER_S
        tf.set_transforms_xact([StampedTransform(*link, stamp_ns, pose) for link in _LINKS])
        next_s += 1 / COMMITS_PER_S
        time.sleep(max(0.0, next_s - time.monotonic()))


def main() -> None:
    tree: TransformTree | TransformClient
    if len(sys.argv) > 1:
        tree = TransformClient.connect(sys.argv[1])
        if tree.reads != "shared":
            raise SystemExit("the server does not share its tree")
    else:
        tree = TransformTree()
        rows = (StampedTransform(*row[:3], Transform(*row[3:])) for row in history())
        tree.set_transforms_xact(list(rows))
    print("ready", flush=True)
    for line in sys.stdin:
        calls, begun_s = 0, time.perf_counter()
        while time.perf_counter() - begun_s < float(line):
            for _ in range(_CALLS):
                tree.lookup_latest_transform_xact(TARGET, SOURCE)
            calls += _CALLS
        print(calls / (time.perf_counter() - begun_s), flush=True)


if __name__ == "__main__":
    main()
