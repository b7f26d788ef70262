"""Threads beside a test, whose errors the test raises."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def beside(*works: Callable[[threading.Event], object]) -> Iterator[None]:
    """Run each on a thread of its own, and set the event that they get at the end of the block."""
    ending = threading.Event()
    with ThreadPoolExecutor(len(works)) as pool:
        running = [pool.submit(work, ending) for work in works]
        try:
            yield
        finally:
            ending.set()
    for each in running:
        each.result()


def together(*calls: Callable[[], object]) -> None:
    """Make the calls on a thread each, and wait until all have ended."""
    with ThreadPoolExecutor(len(calls)) as pool:
        for each in [pool.submit(call) for call in calls]:
            each.result()


@contextmanager
def switching(interval_s: float) -> Iterator[None]:
    """Let the interpreter change threads at this interval."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(interval_s)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)
