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
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import uvloop

from bench.machine import resident_mb
from bench.parts.chain import SOURCE, TARGET
from bench.report import Report, Trial
from bench.server import Server, fill, query_client
from zenoh_tf_client import AsyncTransformClient, TransformClient

#: Calls in a trial of single lookups: few, so that the systems take turns often.
LONE, TOGETHER = 50, 1000
#: More than the client has room for.
UNDER_WAY = 10_000
LOOPS = {"asyncio": asyncio.new_event_loop, "uvloop": uvloop.new_event_loop}

#: Runs a trial of an asynchronous client on its loop.
Run = Callable[[Callable[[AsyncTransformClient], Coroutine[Any, Any, Trial]]], Trial]


def measure(report: Report) -> None:
    """Single lookups by query, many at once, and memory while a stopped server answers none."""
    with (
        Server() as server,
        query_client(server.endpoint) as tf,
        contextlib.ExitStack() as stack,
    ):
        fill(tf)
        loops = {n: stack.enter_context(_client(n, server.endpoint)) for n in LOOPS}
        for case, trial, calls, repetitions, limit in (
            ("one lookup after another", _one_by_one, LONE, 41, 1.15),
            (f"{TOGETHER} lookups, at once if the client can", _at_once, TOGETHER, 9, 1 / 5),
        ):
            runs = {name: functools.partial(run, trial) for name, run in loops.items()}
            runs = {"synchronous": functools.partial(_synchronous, tf, calls)} | runs
            cells = report.compare({"case": case}, runs, repetitions)
            for name in LOOPS:
                values = cells[name].over(cells["synchronous"], "us_per_call")
                report.target(f"{case}, {name} to synchronous", values, "<=", limit)
        for name in LOOPS:
            with _client(name, server.endpoint) as run:
                labels = {"case": f"memory with {UNDER_WAY} lookups under way", "system": name}
                report.add(labels, run(functools.partial(_memory, server.pid)))


@contextlib.contextmanager
def _client(loop: str, endpoint: str) -> Iterator[Run]:
    with contextlib.closing(LOOPS[loop]()) as running:
        connect = AsyncTransformClient.connect(endpoint, timeout_s=60.0, reads="query")
        tf = running.run_until_complete(connect)
        yield lambda trial: running.run_until_complete(trial(tf))
        running.run_until_complete(tf.close())


def _synchronous(tf: TransformClient, calls: int) -> Trial:
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
