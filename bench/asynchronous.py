"""The asynchronous client beside the synchronous one, on asyncio's own loop and on uvloop."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import statistics
import time
import timeit
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import uvloop

from bench.python_system import SOURCE, TARGET, history
from bench.remote import SERVER, running
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import AsyncTransformClient, TransformClient

#: Calls in a trial of single lookups: few, so that the systems take turns often.
LONE = 50
TOGETHER = 1000
#: More than the client has room for.
UNDER_WAY = 10_000
LOOPS = {"asyncio": asyncio.new_event_loop, "uvloop": uvloop.new_event_loop}
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(report: Report) -> None:
    """Single lookups by query, many at once, and memory while a stopped server answers none."""
    with (
        running(*SERVER) as (server, endpoint),
        TransformClient.connect(endpoint, reads="query") as tf,
    ):
        for parent, child, stamp_ns, *pose in history():
            tf.set_transform(StampedTransform(parent, child, stamp_ns, Transform(*pose)))
        with contextlib.ExitStack() as stack:
            loops = {
                name: stack.enter_context(_client(factory, endpoint))
                for name, factory in LOOPS.items()
            }
            _lone(report, tf, loops)
            _together(report, tf, loops)
        _memory(report, endpoint, server.pid)


_Loop = tuple[asyncio.Runner, AsyncTransformClient]


@contextlib.contextmanager
def _client(factory: Callable[[], asyncio.AbstractEventLoop], endpoint: str) -> Iterator[_Loop]:
    with asyncio.Runner(loop_factory=factory) as runner:
        tf = runner.run(AsyncTransformClient.connect(endpoint, timeout_s=60.0, reads="query"))
        yield runner, tf
        runner.run(tf.close())


def _lone(report: Report, tf: TransformClient, loops: dict[str, _Loop]) -> None:
    def blocking() -> Trial:
        times = timeit.repeat(lambda: tf.lookup_transform(TARGET, SOURCE), number=1, repeat=LONE)
        return {"us_per_call": 1e6 * statistics.median(times)}

    async def awaited(client: AsyncTransformClient) -> Trial:
        times = []
        for _ in range(LONE):
            begun_s = time.perf_counter()
            await client.lookup_transform(TARGET, SOURCE)
            times.append(time.perf_counter() - begun_s)
        return {"us_per_call": 1e6 * statistics.median(times)}

    labels = {"case": "one lookup after another"}
    cells = [Cell(labels, "synchronous", run=blocking)]
    cells += [Cell(labels, name, run=_on(loop, awaited)) for name, loop in loops.items()]
    _warm_up(cells)
    report.measure("async", cells, report.repetitions(41), baseline="synchronous")
    for cell in cells[1:]:
        values = ratios(cell.values("us_per_call"), cells[0].values("us_per_call"))
        name = f"a lone lookup on {cell.system} to a synchronous one"
        report.check("async", [Target(name, 1.15, values, False)])


def _together(report: Report, tf: TransformClient, loops: dict[str, _Loop]) -> None:
    def blocking() -> Trial:
        taken_s = timeit.timeit(lambda: tf.lookup_transform(TARGET, SOURCE), number=TOGETHER)
        return {"lookups_per_s": TOGETHER / taken_s}

    async def gathered(client: AsyncTransformClient) -> Trial:
        begun_s = time.perf_counter()
        await asyncio.gather(*(client.lookup_transform(TARGET, SOURCE) for _ in range(TOGETHER)))
        return {"lookups_per_s": TOGETHER / (time.perf_counter() - begun_s)}

    labels = {"case": f"{TOGETHER} lookups, at once if the client can"}
    cells = [Cell(labels, "synchronous", run=blocking)]
    cells += [Cell(labels, name, run=_on(loop, gathered)) for name, loop in loops.items()]
    _warm_up(cells)
    report.measure("async", cells, report.repetitions(9), baseline="synchronous")
    for cell in cells[1:]:
        values = ratios(cell.values("lookups_per_s"), cells[0].values("lookups_per_s"))
        name = f"gathered lookups on {cell.system} to synchronous ones"
        report.check("async", [Target(name, 5, values)])


def _memory(report: Report, endpoint: str, server: int) -> None:
    async def stopped(tf: AsyncTransformClient) -> Trial:
        os.kill(server, signal.SIGSTOP)
        try:
            before_mb = _resident_mb()
            tasks = [
                asyncio.create_task(tf.lookup_transform(TARGET, SOURCE)) for _ in range(UNDER_WAY)
            ]
            await asyncio.sleep(0.2)
            after_mb = _resident_mb()
        finally:
            os.kill(server, signal.SIGCONT)
        await asyncio.gather(*tasks)
        return {"mb": after_mb - before_mb}

    cells = []
    labels = {"case": f"memory with {UNDER_WAY} lookups under way"}
    for name, factory in LOOPS.items():
        with _client(factory, endpoint) as loop:
            cells.append(Cell(labels, name, trials=[_on(loop, stopped)()]))
    report.measure("async", cells, 0)


def _on(
    loop: _Loop, trial: Callable[[AsyncTransformClient], Awaitable[Trial]]
) -> Callable[[], Trial]:
    runner, tf = loop

    async def run() -> Trial:
        return await trial(tf)

    return lambda: runner.run(run())


def _warm_up(cells: list[Cell]) -> None:
    for cell in cells:
        cell.run()


def _resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB
