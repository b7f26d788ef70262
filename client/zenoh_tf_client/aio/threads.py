"""Runs a blocking call on a thread of its own, while the event loop goes on."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

T = TypeVar("T")


async def in_thread(call: Callable[[], T], undo: Callable[[T], object]) -> T:
    """Return what `call` returns, or raise its error.

    A caller that is cancelled does not wait for the call to return; `undo` then gets its result.
    The thread is a daemon: a program that ends does not wait for it.
    """
    future: Future[T] = Future()
    threading.Thread(target=_run, args=(call, undo, future), name="zenoh-tf", daemon=True).start()
    return await asyncio.wrap_future(future)


def _run(call: Callable[[], T], undo: Callable[[T], object], future: Future[T]) -> None:
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
