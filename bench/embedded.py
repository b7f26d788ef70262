"""The embedded tree called from Python, by turns with tf2's own Python binding."""

from __future__ import annotations

import contextlib
import json
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from bench import workload
from bench.figures import REPETITIONS, Bar, Figure
from bench.machine import ROOT
from bench.workload import ROWS, SET_FRAME, SOURCE, TARGET
from zenoh_tf import StampedTransform, Transform, TransformTree

#: Debian's interpreter, for which python3-tf2 is packaged.
_PYTHON_WITH_TF2 = "/usr/bin/python3"
_BLOCK_S = 0.1

Run = Callable[[int], float]  # calls -> seconds


def measure() -> Iterator[Figure]:
    """Microseconds a lookup or a set."""
    cases = _Cases()
    with _tf2() as peer:
        if peer is None:
            print(f"{_PYTHON_WITH_TF2} has no tf2_py (Debian: python3-tf2): no comparison")
        else:
            _check(cases, peer)
        yield _compare("lookup_transform, latest common", cases.lookup_common, peer, bar=Bar(1.0))
        yield _compare("lookup_transform, at a time", cases.lookup_at, peer, bar=Bar(1.0))
        name = f"{ROWS} at a time"
        yield _compare(f"lookup_transforms, {name}", cases.bulk, peer, "lookup_at", Bar(0.12))
        yield _compare(f"sample, {name}", cases.sample, peer, "lookup_at", Bar(0.12))
        yield _compare("set_transform", cases.set_built, peer, bar=Bar(1.2))
        yield _compare("the same with building it", cases.build_and_set, peer)
        yield _compare("lookup_latest_transform", cases.latest, peer, "lookup_common")
        yield _compare("lookup_latest_transform_xact", cases.latest_xact, peer, "lookup_common")


class _Cases:
    def __init__(self) -> None:
        self.tree = TransformTree(cache_time_s=workload.CACHE_S)
        for parent, child, stamp_ns, translation, rotation in workload.history():
            transform = Transform(translation, rotation)
            self.tree.set_transform(StampedTransform(parent, child, stamp_ns, transform))
        self.times = workload.times_ns()
        self.times_array = np.array(self.times)
        self.next_sample = workload.SAMPLES

    def lookup_common(self, calls: int) -> float:
        lookup = self.tree.lookup_transform
        start = time.perf_counter()
        for _ in range(calls):
            lookup(TARGET, SOURCE)
        return time.perf_counter() - start

    def lookup_at(self, calls: int) -> float:
        lookup, times = self.tree.lookup_transform, self.times
        start = time.perf_counter()
        for i in range(calls):
            lookup(TARGET, SOURCE, times[i % ROWS])
        return time.perf_counter() - start

    def latest(self, calls: int) -> float:
        lookup = self.tree.lookup_latest_transform
        start = time.perf_counter()
        for _ in range(calls):
            lookup(TARGET, SOURCE)
        return time.perf_counter() - start

    def latest_xact(self, calls: int) -> float:
        lookup = self.tree.lookup_latest_transform_xact
        start = time.perf_counter()
        for _ in range(calls):
            lookup(TARGET, SOURCE)
        return time.perf_counter() - start

    def bulk(self, lookups: int) -> float:
        lookup, times = self.tree.lookup_transforms, self.times_array
        targets, sources = [TARGET] * ROWS, [SOURCE] * ROWS
        start = time.perf_counter()
        for _ in range(-(-lookups // ROWS)):
            lookup(targets, sources, times)
        return (time.perf_counter() - start) * lookups / (-(-lookups // ROWS) * ROWS)

    def sample(self, lookups: int) -> float:
        sample, times = self.tree.sample, self.times_array
        start = time.perf_counter()
        for _ in range(-(-lookups // ROWS)):
            sample(TARGET, SOURCE, times)
        return (time.perf_counter() - start) * lookups / (-(-lookups // ROWS) * ROWS)

    def set_built(self, calls: int) -> float:
        transform = Transform(*workload.pose(0, 0))
        stampeds = [StampedTransform(TARGET, SET_FRAME, at, transform) for at in self._next(calls)]
        store = self.tree.set_transform
        start = time.perf_counter()
        for stamped in stampeds:
            store(stamped, "bench")
        return time.perf_counter() - start

    def build_and_set(self, calls: int) -> float:
        pose = workload.pose(0, 0)
        stamps_ns = self._next(calls)
        store = self.tree.set_transform
        start = time.perf_counter()
        for stamp_ns in stamps_ns:
            store(StampedTransform(TARGET, SET_FRAME, stamp_ns, Transform(*pose)), "bench")
        return time.perf_counter() - start

    def _next(self, count: int) -> list[int]:
        first, self.next_sample = self.next_sample, self.next_sample + count
        return [workload.START_NS + i * workload.PERIOD_NS for i in range(first, first + count)]


class _Peer:
    """The process that holds tf2."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def request(self, **request: object) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


@contextlib.contextmanager
def _tf2() -> Iterator[_Peer | None]:
    try:
        process = subprocess.Popen(
            [_PYTHON_WITH_TF2, "-m", "bench.tf2_peer"],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
    except FileNotFoundError:
        yield None
        return
    with process:  # its end closes the peer's input, at which it leaves
        assert process.stdout is not None
        yield _Peer(process) if process.stdout.readline() else None


def _check(cases: _Cases, peer: _Peer) -> None:
    """Both give one answer, within 1e-9 and up to the rotation's sign."""
    for stamp_ns in (None, *cases.times[:100]):
        ours = np.array(cases.tree.lookup_transform(TARGET, SOURCE, stamp_ns).transform.pose())
        theirs = np.array(peer.request(ask=stamp_ns))
        theirs[3:] *= np.sign(ours[3:] @ theirs[3:])
        if not np.all(np.abs(ours - theirs) <= 1e-9):
            raise SystemExit(f"answers differ at {stamp_ns}: {ours}, tf2 {theirs}")


def _compare(
    name: str, ours: Run, peer: _Peer | None, other: str = "", bar: Bar | None = None
) -> Figure:
    """By turns, microseconds a call. `other`: tf2's case, where it has another name."""

    def theirs(calls: int) -> float:
        assert peer is not None
        return float(peer.request(case=other or ours.__name__, calls=calls))

    sides = [ours] if peer is None else [ours, theirs]
    calls = [_calls_for(side) for side in sides]
    values: list[list[float]] = [[] for _ in sides]
    for _ in range(REPETITIONS):
        for side, count, spent in zip(sides, calls, values, strict=True):
            spent.append(1e6 * side(count) / count)
    return Figure(name, "us", values[0], "tf2", values[1] if peer else None, bar)


def _calls_for(run: Run) -> int:
    """Calls that fill a block; doubles as the warm-up."""
    calls = 1000
    while (spent := run(calls)) < _BLOCK_S / 4:
        calls *= 2
    return max(1, round(calls * _BLOCK_S / spent))
