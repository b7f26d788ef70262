"""Processes that read a server's memory at full rate, beside 1,000 commits a second."""

from __future__ import annotations

import functools
import multiprocessing
import threading
import time
from multiprocessing.connection import Connection
from typing import Final

from bench.machine import cpu_s
from bench.python_system import END_NS, SOURCE, TARGET, history
from bench.remote import SERVER, running
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


class _Reader:
    """A process that reads a tree of its own, or the server's where there is an endpoint."""

    def __init__(self, endpoint: str | None) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_read, args=(endpoint, theirs), daemon=True)
        self._process.start()
        self._pipe.recv()  # it is ready

    def begin(self, seconds: float) -> None:
        self._pipe.send(seconds)

    def rate(self) -> float:
        """Lookups a second since `begin`."""
        rate: float = self._pipe.recv()
        return rate

    def end(self) -> None:
        self._process.kill()
        self._process.join()


def measure(report: Report) -> None:
    """Lookups a second of all processes, and the cores that the server uses."""
    with running(*SERVER) as (server, endpoint), TransformClient.connect(endpoint) as tf:
        tf.set_transforms_xact([_stamped(*row) for row in history()])
        ending = threading.Event()
        writer = threading.Thread(target=_write, args=(tf, ending))
        shared = [_Reader(endpoint) for _ in range(max(READERS))]
        own = [_Reader(None) for _ in range(max(READERS))]
        writer.start()
        try:
            _compare(report, server.pid, shared, own)
        finally:
            ending.set()
            writer.join()
            for reader in shared + own:
                reader.end()


def _compare(report: Report, server: int, shared: list[_Reader], own: list[_Reader]) -> None:
    seconds = report.seconds(SLICE_S)
    cells = {
        (count, way): Cell(
            {"reader processes": count},
            way,
            run=functools.partial(_trial, readers[:count], server, seconds),
        )
        for count in READERS
        for way, readers in ((OWN, own), (SHARED, shared))
    }
    idle = Cell({"reader processes": 0}, "none", run=functools.partial(_trial, [], server, seconds))
    report.measure("readers", [idle, *cells.values()], report.repetitions(), OWN)
    targets = []
    for count in READERS:
        ours, theirs = (cells[count, way].values("lookups_per_s") for way in (SHARED, OWN))
        to_own = ratios(ours, theirs)
        targets.append(Target(f"{count} processes, server's memory to own tree", 1 / 1.5, to_own))
    report.check("readers", targets)


def _trial(readers: list[_Reader], server: int, seconds: float) -> Trial:
    cpu, start = cpu_s(server), time.perf_counter()
    for reader in readers:
        reader.begin(seconds)
    if not readers:
        time.sleep(seconds)
    rates = [reader.rate() for reader in readers]
    cores = (cpu_s(server) - cpu) / (time.perf_counter() - start)
    return {"server_cores": cores} | ({"lookups_per_s": sum(rates)} if rates else {})


def _stamped(parent: str, child: str, stamp_ns: int, *pose: object) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform(*pose))  # type: ignore[arg-type]


def _write(tf: TransformClient, ending: threading.Event) -> None:
    """Commits two of the links that are read, together, at the rate."""
    next_s, stamp_ns = time.monotonic(), END_NS
    while not ending.is_set():
        stamp_ns += 1_000_000_000 // COMMITS_PER_S
        tf.set_transforms_xact([_stamped(*link, stamp_ns) for link in _LINKS])
        next_s += 1 / COMMITS_PER_S
        time.sleep(max(0.0, next_s - time.monotonic()))


def _read(endpoint: str | None, pipe: Connection) -> None:
    tree: TransformTree | TransformClient = TransformTree()
    if endpoint is None:
        tree.set_transforms_xact([_stamped(*row) for row in history()])
    else:
        tree = TransformClient.connect(endpoint)
        if tree.reads != "shared":
            raise SystemExit("the server does not share its tree")
    lookup = tree.lookup_latest_transform_xact
    pipe.send("ready")
    while True:
        seconds = pipe.recv()
        calls, start = 0, time.perf_counter()
        while time.perf_counter() - start < seconds:
            for _ in range(_CALLS):
                lookup(TARGET, SOURCE)
            calls += _CALLS
        pipe.send(calls / (time.perf_counter() - start))
