"""The core without Python, beside the real tf2: builds bench/core, and orders its trials."""

from __future__ import annotations

import functools
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.machine import ROOT
from bench.process import Process
from bench.report import Cell, Report, equal_poses

#: Deeper than a tree allows without an option.
QUICK_LINKS = 10_000
COMMON, XACT = "latest-common", "latest-xact"
Labels = Mapping[str, object]


@functools.cache
def build(source: str, quick: bool, *definitions: str) -> Path:
    """Build a folder's programs and return where they are: once, so that all parts of a run measure
    the same programs. `quick` measures nothing, so it needs them in short time, not fast."""
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    folder = "build/" + source.replace("/", "-") + ("-quick" if quick else "")
    configure = f"cmake -S {source} -B {folder} -G Ninja --log-level=WARNING"
    configure = " ".join([configure, *definitions])
    if quick:
        configure += " -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=0"
        configure += " -DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS=-O1"
    build = f'CXX="$(sh scripts/compiler.sh)" {configure} && cmake --build {folder} -- --quiet'
    subprocess.run(["sh", "-c", build], cwd=ROOT, env=environment, check=True, stdout=sys.stderr)
    return ROOT / folder


class Program:
    """bench_core with a row of links, a process for each system that is installed."""

    def __init__(self, report: Report, links: int, *systems: str, **settings: float) -> None:
        defaults: dict[str, float] = {
            "samples": 1,
            "period_ns": 1000,
            "cache_s": 3600,
            "max_samples": 65536,
        }
        defaults |= {"child_to_parent": 0, "offset_ns": 0, "rad_per_ms": 0.002, "grasp": 0}
        words = _words({"links": links, **defaults, **settings})
        program = str(build("bench/core", report.quick) / "bench_core")
        self._processes = {
            system: Process(program, f"system={system}", *words, wait=False)
            for system in systems or ("optimistic", "2pl", "giant", "tf2")
        }  # they build their trees side by side
        found = {name: json.loads(each.read_line()) for name, each in self._processes.items()}
        #: Of the systems that are installed; without tf2 its answer is empty.
        self.memory: dict[str, dict[str, float]] = {name: m for name, m in found.items() if m}

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.communicate()  # closes its input, at which it ends

    def ask(self, command: str, system: str, **settings: Any) -> Any:
        """Sends a command; returns its answer."""
        return self._processes[system].ask(" ".join([command, *_words(settings)]))

    def pairs(self, *reads: str) -> list[tuple[str, str]]:
        """The kinds of lookup with each system that has them; tf2 has no atomic one."""
        pairs = itertools.product(reads, self.memory)
        return [pair for pair in pairs if pair != (XACT, "tf2")]

    def check(self, *reads: str, **settings: int) -> None:
        """Ends the benchmark if the answers of two systems differ."""
        for read in reads:
            systems = [system for _, system in self.pairs(read)]
            first, *others = (self.ask("answers", each, read=read, **settings) for each in systems)
            if not all(all(map(equal_poses, first, answers)) for answers in others):
                raise SystemExit(f"answers to {read} differ")

    def cells(
        self, labels: Labels, reads: Sequence[str], run: Labels, command: str = "trial"
    ) -> list[Cell]:
        """A cell for each system and each kind of lookup."""
        cells = []
        for read, system in self.pairs(*reads):
            ask = functools.partial(self.ask, command, system, read=read, **run)
            cells.append(Cell({**labels, "system": system, "read": read}, ask))
        return cells


def _words(settings: Labels) -> list[str]:
    return [f"{name}={value}" for name, value in settings.items()]


#: Histories at 100 Hz, and what is looked up in each: the name, the kind of lookup, and how many
#: times tf2's rate 1 and 2 threads must reach. A robot's links have stamps of their own, and some
#: turn by 5 degrees between two samples.
LOOKUPS: Mapping[str, tuple[Mapping[str, float], Sequence[tuple[str, str, tuple[int, ...]]]]] = {
    "equal stamps": (
        {},
        (
            ("latest common, ids", COMMON, (10, 35)),
            ("latest common, names", "latest-common-by-name", (4,)),
            ("at a time, ids", "at", (10,)),
            ("set, full history", COMMON, ()),  # last, because it changes the history
        ),
    ),
    "unequal stamps": (
        {"offset_ns": 2_300_000},
        (
            ("latest common, unequal stamps", COMMON, (12,)),
            ("at a time, unequal stamps", "at", (12,)),
        ),
    ),
    "fast links": (
        {"offset_ns": 2_300_000, "rad_per_ms": 0.01},
        (("latest common, fast links", COMMON, (12,)), ("at a time, fast links", "at", (12,))),
    ),
    "after a grasp": (
        {"offset_ns": 2_300_000, "grasp": 1},
        (
            ("latest common, after a grasp", COMMON, (12,)),
            ("at a time, after a grasp", "at", (12,)),
        ),
    ),
}


def lookups(report: Report) -> None:
    """Lookups at depth 4 and single sets, with 10 s of history at 100 Hz."""
    history = {"samples": 1000, "period_ns": 10_000_000, "cache_s": 10}
    for settings, cases in LOOKUPS.values():
        with Program(report, 4, **history, **settings) as program:
            for name, read, limits in cases:
                _lookups(report, program, name, read, limits)


def _lookups(report: Report, program: Program, name: str, read: str, limits: Sequence[int]) -> None:
    program.check(read, length=4, vary=0)
    for threads in (1, 2):
        readers = 0 if name.startswith("set") else threads
        run: dict[str, float] = {"readers": readers, "writers": threads - readers}
        run |= {"length": 4, "own_links": 1, "seconds": report.seconds(0.05)}
        cells = program.cells({"case": name, "threads": threads}, [read], run)
        found = {each.labels["system"]: each for each in report.measure(cells, 15)}
        if "tf2" in found and threads <= len(limits):
            title = f"{name}, {threads} threads: to tf2's"
            values = found["optimistic"].over(found["tf2"], "operations_per_s")
            report.target(title, values, ">=", limits[threads - 1])


#: The report's lookup with each concurrency control over the same records; tf2's lookup with both.
PAPER_READS = {
    *((system, XACT) for system in ("optimistic", "2pl", "giant")),
    *((system, COMMON) for system in ("optimistic", "tf2")),
}


def paper(report: Report) -> None:
    """Readers and writers on a snake of a million links, after Kawashima 2022."""
    _paper(report, QUICK_LINKS if report.quick else 1_000_000)


def paper_cached(report: Report) -> None:
    """The same with as many links as the processor's caches hold."""
    _paper(report, 1000)


def _paper(report: Report, links: int) -> None:
    cores = max(2, os.cpu_count() or 2)
    counts = [n for n in (1, 2, 4, 8, 16) if n <= cores or n == 8]
    half = min(cores, 16) // 2
    cells: list[Cell] = []
    for direction, roles in (("opposite", mixes(counts)), ("same", [(half, half)])):
        cells += _snake(report, links, direction, roles)
    check_paper(report, cells, cores)


def mixes(counts: list[int]) -> list[tuple[int, int]]:
    """Readers and writers: half and half for every number of threads; for the lowest numbers and
    the highest also without writers, and for the highest with one."""
    read_only = [(n, 0) for n in (*(n for n in counts if n <= 2), counts[-1])]
    return [*read_only, *((n // 2, n // 2) for n in counts if n > 1), (counts[-1] - 1, 1)]


def _snake(report: Report, links: int, direction: str, roles: list[tuple[int, int]]) -> list[Cell]:
    # With fewer samples, or a shorter history, more reads at a common time find that a link has
    # dropped its sample of that time.
    cache_s, samples = (3600, 16) if links > 100_000 else (1, 64)
    settings = {"cache_s": cache_s, "max_samples": samples, "samples": samples + 1}
    settings["child_to_parent"] = int(direction == "same")
    labels, seconds = {"links": links, "direction": direction}, report.seconds(0.15)
    cells: list[Cell] = []
    with Program(report, links, **settings) as program:
        for writing in (False, True):  # first without writers, while all links are of one age
            program.check(COMMON, XACT, length=16, vary=int(writing))
            plan = [each for each in roles if (each[1] > 0) == writing]
            cells += report.measure(_threads(program, labels, plan, seconds))
    return cells


def _threads(
    program: Program, labels: Labels, roles: list[tuple[int, int]], seconds: float
) -> list[Cell]:
    """Cells of the report's reads and writes, for each number of readers and writers."""
    cells: list[Cell] = []
    for readers, writers in roles:
        threads = {"readers": readers, "writers": writers}
        run = {**threads, "length": 16, "own_links": 0, "seconds": seconds}
        cells += program.cells({**labels, **threads}, (XACT, COMMON), run)
    return [each for each in cells if (each.labels["system"], each.labels["read"]) in PAPER_READS]


def check_paper(report: Report, cells: Sequence[Cell], cores: int) -> None:
    """Checks every target that these cells can say anything about."""
    found = {tuple(cell.labels.values()): cell for cell in cells}
    for (links, direction, readers, writers, system, read), cell in found.items():
        for other, roles, name, sign, limit, *metrics in _goals(links, readers, writers, cores):
            base = found.get((links, direction, *roles, other, COMMON if other == "tf2" else read))
            if system == "optimistic" and base:
                where = f"{links:,} links, {direction}, {readers} readers, {writers} writers"
                report.target(f"{where}, {read}: {name}", cell.over(base, *metrics), sign, limit)


def _goals(links: int, readers: int, writers: int, cores: int) -> Iterator[tuple[Any, ...]]:
    """For a cell of ours: another system, its readers and writers, what is compared, the limit,
    and the metrics of both."""
    own, one, half = (readers, writers), (1, 0), (cores // 2, cores // 2)
    reads, writes = "reads_per_s", "links_written_per_s"
    yield "2pl", own, "reads to 2pl's", ">=", 1, reads
    yield "2pl", own, "link writes to 2pl's", ">=", 1, writes
    if own == (1, 1):
        large = links > 100_000
        yield "tf2", own, "reads to tf2's", ">=", 8 if large else 12, reads
        yield "tf2", own, "link writes to tf2's", ">=", 80 if large else 120, writes
        yield "tf2", own, "read p99.9 to tf2's p50", "<=", 1, "read_us_p999", "read_us_p50"
    if readers == writers > half[0]:
        yield "optimistic", half, f"reads to {cores} threads'", ">=", 0.8, reads
        yield "optimistic", half, f"link writes to {cores} threads'", ">=", 0.8, writes
    if own == (2, 0):
        yield "optimistic", one, "reads to 1 thread's", ">=", 1.9, reads
    if readers + writers == 16 and cores >= 16:  # what the report reached with 224 threads
        yield "tf2", own, "operations to tf2's", ">=", 143, "operations_per_s"
        if writers == 0:
            yield "optimistic", one, "reads to 1 thread's", ">=", 14, reads


def delay(report: Report) -> None:
    """The age of the data used, on a million links: tf2 takes a minute to set each of them once."""
    links = QUICK_LINKS if report.quick else 1_000_000
    many, seconds = (8, 30) if (os.cpu_count() or 1) >= 16 else (4, 60)
    for half in (1, many):  # a process each: in a second run the data would begin old
        with Program(report, links, "optimistic", "tf2", samples=17, max_samples=16) as program:
            labels = {"links": links, "seconds": seconds}
            cells = _threads(program, labels, [(half, half)], report.seconds(seconds))
            # Of each system, the lookup that the report measures of it.
            wanted = {"optimistic": XACT, "tf2": COMMON}
            own = [each for each in cells if each.labels["read"] == wanted[each.labels["system"]]]
            report.measure(own, 1)


#: Links from the map down to the gripper, and how often they are published, in Hz.
SOURCES = {"map to odom": 10, "odom to base": 50, "base to arm": 200, "arm to gripper": 200}


def staleness(report: Report) -> None:
    """Publishers at fixed rates: how old the data of a lookup is, link by link."""
    run = {"seconds": report.seconds(3), "rates_hz": ",".join(map(str, SOURCES.values()))}
    with Program(report, len(SOURCES), "optimistic", "tf2") as program:
        cells = program.cells({}, (COMMON, XACT), run, "staleness")
        report.take_turns(cells, 3)
    for i, (link, rate) in enumerate(SOURCES.items()):
        for cell in cells:
            means, tails = (cell.values(f"link{i}_{name}") for name in ("ms_mean", "ms_p99"))
            trials = [{"ms_mean": a, "ms_p99": b} for a, b in zip(means, tails, strict=True)]
            report.add({"link": link, "rate_hz": rate} | cell.labels, *trials)


def memory(report: Report) -> None:
    """Bytes for a frame, by the samples that it holds."""
    frames = QUICK_LINKS if report.quick else 100_000
    for samples in (1, 2, 4, 8, 16, 64):
        with Program(report, frames, "optimistic", "tf2", samples=samples) as program:
            for system, trial in program.memory.items():
                report.add({"samples": samples, "system": system}, trial)
