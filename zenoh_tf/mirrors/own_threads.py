"""Runs a feed on threads of its own: one listens, and one more takes the steps of each routine.

Thread safety: all methods.

Internal: for `zenoh_tf.mirrors.feed`.
"""

from __future__ import annotations

import contextlib
import threading
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import zenoh

from .. import threads
from ..errors import ServerUnavailable
from ..steps import Ask, Pause, Steps, run

if TYPE_CHECKING:
    from .feed import MirrorFeed

#: Messages that are taken at once: a busy program lets the thread run only now and then.
_BATCH_MESSAGES: Final = 16


class OwnThreads:
    """The `Runner` of clients and replicas, whose mirrors must not wait for each other."""

    def listen(self, feed: MirrorFeed) -> threading.Thread:
        """Start the thread that listens."""
        return threads.start("mirror", _listen, feed)

    def run(self, feed: MirrorFeed, steps: Steps[None]) -> bool:
        """Start a thread for a routine. False: there are too many, or the program is ending."""
        try:
            threads.start("mirror request", run, steps, partial(_take, feed))
        except RuntimeError:
            return False
        return True


def _listen(feed: MirrorFeed) -> None:
    """Apply messages until the mirror or the connection is closed."""
    try:
        while not feed.closed:
            subscriber = feed.subscriber
            with contextlib.suppress(zenoh.ZError, ServerUnavailable):  # undeclared, or closed
                _listen_to(feed, subscriber.handler)
            if subscriber is feed.subscriber:  # no other one has taken its place
                break
    finally:
        feed.end()


def _listen_to(feed: MirrorFeed, receiver: Any) -> None:
    calls = feed.source.calls
    while not feed.closed:
        with calls:
            batch = [receiver.recv()]
            while len(batch) < _BATCH_MESSAGES and (sample := receiver.try_recv()):
                batch.append(sample)
        feed.take(batch)


def _take(feed: MirrorFeed, step: Ask | Pause) -> object:
    """Take one step of a routine; return its outcome."""
    if isinstance(step, Pause):
        return feed.wait_for_end(step.seconds)
    return feed.source.take(step)
