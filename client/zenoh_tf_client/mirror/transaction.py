"""`MirrorTransaction`: a transaction whose reads are in a mirror."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, TypeVar

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import ServerUnavailable
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.shared_tree import AskServer

from ..requests.lookups import Lookup, VersionedRead, read_versions
from ..requests.receipt import Receipt
from ..session.connection import Connection
from ..session.mapped_tree import MappedTree
from ..transaction import Transaction
from .interest import OutsideInterest, explained

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")

#: A transaction waits this long for the mirror.
_CATCH_UP_S: Final = 1.0
#: Attempts that read in a mirror of some frames. The read set may have a frame above those that the
#: mirror has, in which case it conflicts each time.
_PARTIAL_ATTEMPTS: Final = 2


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
        self._feed.wait(lambda: self.has(names), _CATCH_UP_S)


class MirrorTransaction(Transaction):
    """One attempt, which reads one copy of the tree. Thread safety: one thread at a time.

    A mirror's frames have the server's versions, so its reads can be the read set of a commit.
    After a conflict it reads once the mirror has what it was in conflict with. If that takes long,
    it reads by query.
    """

    def __init__(
        self,
        connection: Connection,
        mapped: MappedTree,
        feed: MirrorFeed,
        own_writes: OwnWrites,
        interest: wire.Interest | None,
        attempt: int,
    ) -> None:
        """`feed`, `own_writes` and `interest`: the mirror's. `attempt`: its number, from 1 on."""
        super().__init__(connection, mapped)
        self._feed = feed
        self._own_writes = own_writes
        self._interest = interest
        self._attempt = attempt
        self._tree: TransformTree | None = None  # None: it reads by query
        self._copy_of = ""

    def __enter__(self) -> Self:
        interest = self._interest
        # A thinned mirror has the versions of the server, but not all samples.
        if interest is not None and (interest.period_ns > 0 or self._attempt > _PARTIAL_ATTEMPTS):
            return self
        has_caught_up = self._has_caught_up()
        state = self._feed.state
        if state.tree is None:
            raise ServerUnavailable("the mirror is closed")
        if has_caught_up:
            self._tree, self._copy_of = state.tree, state.instance
        return self

    def _has_caught_up(self) -> bool:
        """Wait until the mirror has what the last attempt was in conflict with."""
        feed, wanted = self._feed, self._connection.last_receipt
        if self._attempt == 1 or wanted is None:
            return True
        return feed.wait(lambda: feed.state.has(wanted.instance, wanted.seq), _CATCH_UP_S)

    def commit(self) -> None:
        super().commit()
        if self._sets:
            frames = [stamped.child_frame for stamped in self._sets]
            self._own_writes.add(frames, self._connection.last_receipt)

    def check_reads(self, error: Exception) -> None:
        if not isinstance(error, OutsideInterest):  # which is no error of the server's tree
            super().check_reads(error)

    def _reads_agree(self) -> bool:
        # Unlike at the server, a single read may be old.
        return super()._reads_agree() if self._tree is None else not self._reads

    def _read_versions(self, request: Lookup[T]) -> VersionedRead[T]:
        tree = self._tree
        if tree is None:
            return super()._read_versions(request)
        found = self._look_up(tree, request)
        frames = [name for name, _ in found[1]]
        if self._own_writes.has(frames):
            return found
        self._own_writes.wait_for(frames)
        return self._look_up(tree, request)

    def _look_up(
        self, tree: TransformTree, request: Lookup[T]
    ) -> tuple[str, list[tuple[str, int]], Callable[[], T]]:
        found = read_versions(tree, self._copy_of, request)
        assert not isinstance(found, AskServer)  # only a mapped tree may be unable to answer
        instance, versions, answer = found
        if self._interest is not None:
            answer = explained(answer, tree, self._interest)
        return instance, list(versions), answer
