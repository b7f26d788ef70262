"""Blocking calls on threads of their own, which do not hold up the event loop.

The threads are daemons: a program that ends does not wait for what they wait for.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import TypeVar

from zenoh_tf import threads

T = TypeVar("T")

_Job = Callable[[], object]


async def in_thread(call: Callable[[], T], undo: Callable[[T], object] = lambda _: None) -> T:
    """Return what `call` returns, or raise its error.

    A caller that is cancelled does not wait for the call to return; `undo` then gets its result.
    """
    future: Future[T] = Future()
    threads.start("zenoh-tf", _fill, future, call, undo)
    return await asyncio.wrap_future(future)


def _fill(future: Future[T], call: Callable[[], T], undo: Callable[[T], object]) -> None:
    if future.cancelled():
        return
    try:
        result = call()
    except BaseException as error:
        if future.set_running_or_notify_cancel():
            future.set_exception(error)
        return
    if future.set_running_or_notify_cancel():
        future.set_result(result)
    else:
        undo(result)


class Worker:
    """A thread that makes calls one after another. It ends with the last reference to this."""

    def __init__(self) -> None:
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        self._is_started = False
        self._begun = 0
        self._finished = 0  # counted by the thread

    @property
    def is_busy(self) -> bool:
        """Whether a call has not returned yet."""
        return self._begun != self._finished

    def __del__(self) -> None:
        self._jobs.put(None)

    def start(self, job: _Job) -> None:
        """Let the thread make a call that raises nothing."""
        if not self._is_started:
            self._is_started = True
            threads.start("zenoh-tf send", _work, self._jobs)
        self._begun += 1

        def counted() -> None:
            job()
            self._finished += 1

        self._jobs.put(counted)

    async def run(self, call: Callable[[], T]) -> T:
        """Return what a call returns, or raise its error."""
        future: Future[T] = Future()
        self.start(lambda: _fill(future, call, lambda _: None))
        return await asyncio.wrap_future(future)


def _work(jobs: SimpleQueue[_Job | None]) -> None:
    while (job := jobs.get()) is not None:
        job()
        del job  # or the wait would keep alive what it refers to
