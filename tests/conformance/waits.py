"""Helpers for waiting lookups on threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from tests.support.waiting import wait_until

from .shorthand import Tree

T = TypeVar("T")

#: A time-out that no lookup reaches, as it is beyond that of a test, and how long an answer that
#: is under way may take.
LONG_S = 90.0
SOON_S = 15.0


@contextmanager
def asking(tf: Tree, question: Callable[[], T], waiters: int = 1) -> Iterator[Future[T]]:
    """Run a lookup on a thread; the block starts once the tree has this many waiters."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(question)
        settle(tf, waiters)
        assert not future.done()
        yield future


def settle(tf: Tree, waiters: int = 0) -> None:
    """Wait until so many lookups wait. A woken lookup needs a moment until it waits again."""
    wait_until(lambda: tf.stats()["waiters"] == waiters, tf.stats)


def assert_waits(tf: Tree, future: Future[T]) -> None:
    """Check that the only waiting lookup has not been answered."""
    settle(tf, 1)
    assert not future.done()


def assert_at_once(question: Callable[[], T]) -> T:
    """Check that a call with the time-out LONG_S returns without waiting for it."""
    return question()
