"""What the transactions of a mirror read, and what they wait for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Final, TypeVar

from zenoh_tf import TransformTree, wire
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.shared_tree import AskServer

from ..requests.lookups import Lookup, read_versions
from ..requests.receipt import Receipt
from .interest import explained

T = TypeVar("T")

#: A transaction waits this long for the mirror.
CATCH_UP_S: Final = 1.0
#: Attempts that read in a mirror of some frames. The read set may have a frame above those that the
#: mirror has, in which case it conflicts each time.
_PARTIAL_ATTEMPTS: Final = 2


def reads_by_query(interest: wire.Interest | None, attempt: int) -> bool:
    """Whether an attempt, from 1 on, must not read in the mirror. A thinned one has the versions of
    the server, but not all samples."""
    return interest is not None and (interest.period_ns > 0 or attempt > _PARTIAL_ATTEMPTS)


class OwnWrites:
    """The frames that a mirror's transactions have written, until the mirror has them: to read an
    older state of them would only lead to a conflict. Thread safety: all methods."""

    def __init__(self, feed: MirrorFeed) -> None:
        self._feed = feed
        self._lock = threading.Lock()
        self._receipts: dict[str, Receipt] = {}

    def add(self, frames: Iterable[str], receipt: Receipt | None) -> None:
        """Record a write."""
        if receipt is None:
            return
        state = self._feed.state
        with self._lock:
            for name, known in list(self._receipts.items()):
                if state.has(known.instance, known.seq):
                    del self._receipts[name]
            self._receipts.update(dict.fromkeys(frames, receipt))

    def has(self, frames: Iterable[str]) -> bool:
        """Whether the mirror has all writes to these frames."""
        state = self._feed.state
        with self._lock:
            awaited = [self._receipts[name] for name in frames if name in self._receipts]
        return all(state.has(one.instance, one.seq) for one in awaited)

    def wait_for(self, frames: Iterable[str]) -> None:
        """Wait until it has them, but not for long."""
        names = list(frames)
        self._feed.wait(lambda: self.has(names), CATCH_UP_S)


def look_up(
    tree: TransformTree,
    instance: str,
    request: Lookup[T],
    interest: wire.Interest | None,
) -> tuple[str, list[tuple[str, int]], Callable[[], T]]:
    """Look up in a mirror's tree, with the versions that were read."""
    found = read_versions(tree, instance, request)
    assert not isinstance(found, AskServer)  # only a mapped tree may be unable to answer
    instance, versions, answer = found
    if interest is not None:
        answer = explained(answer, tree, interest)
    return instance, list(versions), answer
