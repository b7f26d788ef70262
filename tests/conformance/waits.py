"""Lookups that wait, on threads, and what a row wants to know of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from .shorthand import Tree

T = TypeVar("T")

#: A wait that a row expects to be over long before; and how long it is given to be over.
LONG_S = 30.0
SOON_S = 15.0


@contextmanager
def asking(tf: Tree, question: Callable[[], T], waiters: int = 1) -> Iterator[Future[T]]:
    """Ask on a thread; the block begins when the tree has this many waiters."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(question)
        settle(tf, waiters)
        assert not future.done()
        yield future


def settle(tf: Tree, waiters: int = 0) -> None:
    """Until so many lookups wait; between being woken and waiting again there is a moment."""
    deadline_s = time.monotonic() + SOON_S
    while (waiting := tf.stats()["waiters"]) != waiters:
        assert time.monotonic() < deadline_s, f"{waiting} waiters, not {waiters}"
        time.sleep(0.001)


def assert_waits(tf: Tree, future: Future[T]) -> None:
    """The only lookup that waits has not been answered."""
    settle(tf, 1)
    assert not future.done()


def assert_at_once(question: Callable[[], T]) -> T:
    """What is answered without waiting for anything, a failure included."""
    begun_s = time.monotonic()
    try:
        return question()
    finally:
        assert time.monotonic() - begun_s < SOON_S
