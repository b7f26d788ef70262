"""`MirrorTransaction`: a transaction whose reads are in a mirror."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import ServerUnavailable
from zenoh_tf.mirrors.feed import MirrorFeed

from ..requests.lookups import Lookup, VersionedRead
from ..session.connection import Connection
from ..session.mapped_tree import MappedTree
from ..transaction import Transaction
from .interest import OutsideInterest
from .transaction_reads import CATCH_UP_S, OwnWrites, look_up, reads_by_query

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")


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
        if not reads_by_query(self._interest, self._attempt):
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
        return feed.wait(lambda: feed.state.has(wanted.instance, wanted.seq), CATCH_UP_S)

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
        found = look_up(tree, self._copy_of, request, self._interest)
        frames = [name for name, _ in found[1]]
        if self._own_writes.has(frames):
            return found
        self._own_writes.wait_for(frames)
        return look_up(tree, self._copy_of, request, self._interest)
