"""The asynchronous client beside the synchronous one, on asyncio's own loop and on uvloop."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import os
import signal
import statistics
import time
import timeit
from collections.abc import Awaitable, Callable, Iterator

import uvloop

from bench.machine import resident_mb
from bench.process import server
from bench.python_system import SOURCE, TARGET
from bench.queries import fill
from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf_client import AsyncTransformClient, TransformClient

#: Calls in a trial of single lookups: few, so that the systems take turns often.
LONE = 50
TOGETHER = 1000
#: More than the client has room for.
UNDER_WAY = 10_000
LOOPS = {"asyncio": asyncio.new_event_loop, "uvloop": uvloop.new_event_loop}

_Loop = tuple[asyncio.Runner, AsyncTransformClient]


def measure(report: Report) -> None:
    """Single lookups by query, many at once, and memory while a stopped server answers none."""
    with (
        server() as (process, endpoint),
        TransformClient.connect(endpoint, reads="query") as tf,
        contextlib.ExitStack() as stack,
    ):
        fill(tf)
        loops = {n: stack.enter_context(_client(make, endpoint)) for n, make in LOOPS.items()}
        for name, trial, calls, repetitions, limit in (
            ("one lookup after another", _one_by_one, LONE, 41, 1.15),
            (f"{TOGETHER} lookups, at once if the client can", _at_once, TOGETHER, 9, 1 / 5),
        ):
            cells = [Cell({"case": name}, "synchronous", run=functools.partial(_sync, tf, calls))]
            for loop_name, loop in loops.items():
                run = functools.partial(_run, loop, trial)
                cells.append(Cell({"case": name}, loop_name, run=run))
            for cell in cells:
                cell.run()  # warms up
            report.measure(cells, report.repetitions(repetitions))
            us = [cell.values("us_per_call") for cell in cells]
            report.check(
                Target(f"{name}, {cell.system} to synchronous", limit, ratios(own, us[0]), False)
                for cell, own in zip(cells[1:], us[1:], strict=True)
            )
        labels = {"case": f"memory with {UNDER_WAY} lookups under way"}
        cells = []
        for loop_name, make in LOOPS.items():
            with _client(make, endpoint) as fresh:
                trials = [_run(fresh, functools.partial(_memory, process.pid))]
                cells.append(Cell(labels, loop_name, trials=trials))
        report.measure(cells, 0)


@contextlib.contextmanager
def _client(factory: Callable[[], asyncio.AbstractEventLoop], endpoint: str) -> Iterator[_Loop]:
    with asyncio.Runner(loop_factory=factory) as runner:
        tf = runner.run(AsyncTransformClient.connect(endpoint, timeout_s=60.0, reads="query"))
        yield runner, tf
        runner.run(tf.close())


def _run(loop: _Loop, trial: Callable[[AsyncTransformClient], Awaitable[Trial]]) -> Trial:
    runner, tf = loop

    async def run() -> Trial:
        return await trial(tf)

    return runner.run(run())


def _sync(tf: TransformClient, calls: int) -> Trial:
    times = timeit.repeat(lambda: tf.lookup_transform(TARGET, SOURCE), number=1, repeat=calls)
    return {"us_per_call": 1e6 * statistics.median(times)}


async def _one_by_one(tf: AsyncTransformClient) -> Trial:
    times = []
    for _ in range(LONE):
        begun_s = time.perf_counter()
        await tf.lookup_transform(TARGET, SOURCE)
        times.append(time.perf_counter() - begun_s)
    return {"us_per_call": 1e6 * statistics.median(times)}


async def _at_once(tf: AsyncTransformClient) -> Trial:
    begun_s = time.perf_counter()
    await asyncio.gather(*(tf.lookup_transform(TARGET, SOURCE) for _ in range(TOGETHER)))
    return {"us_per_call": 1e6 * (time.perf_counter() - begun_s) / TOGETHER}


async def _memory(pid: int, tf: AsyncTransformClient) -> Trial:
    os.kill(pid, signal.SIGSTOP)
    try:
        before_mb = resident_mb()
        lookups = (tf.lookup_transform(TARGET, SOURCE) for _ in range(UNDER_WAY))
        tasks = [asyncio.ensure_future(lookup) for lookup in lookups]
        await asyncio.sleep(0.2)
        after_mb = resident_mb()
    finally:
        os.kill(pid, signal.SIGCONT)
    await asyncio.gather(*tasks)
    return {"mb": after_mb - before_mb}
