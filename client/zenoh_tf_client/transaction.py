"""`Transaction`: read-modify-write, strictly serializable, with no lock held over the network.

    def move(tx):
        gripper = tx.lookup_latest_transform_xact("map", "gripper")
        tx.set_transform(StampedTransform("map", "object", now, gripper.transform))

    tf.run_transaction(move)

The reads record the versions of the frames that they saw: the read set. The sets are kept in
the client, as the write set. The commit sends both; the server validates the read set and
applies the write set atomically, or answers TransactionConflict. `run_transaction` then tries
again; ``with tf.transaction() as tx:`` tries once.
"""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/transaction.py: edit that.

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from zenoh_tf import LatestTransform, StampedTransform, threads
from zenoh_tf.errors import (
    InvalidArgumentException,
    OutcomeUnknown,
    ServerRestarted,
    ServerUnavailable,
    TransactionConflict,
    must_be,
)
from zenoh_tf.shared_tree import AskServer

from .requests import columns, lookups, writes
from .requests.lookups import Lookup, VersionedRead
from .session.connection import Connection
from .session.mapped_tree import MappedTree

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")

#: The pause between attempts is random, up to a bound that doubles (exponential backoff).
FIRST_PAUSE_S = 0.001
LONGEST_PAUSE_S = 0.1


class Transaction:
    """One attempt at a read-modify-write; made by `TransformClient.transaction`.

    A context manager: the end of the block commits, unless an exception ends it. Reads do not see
    the transaction's own sets, and do not wait. They raise the errors of the client's, and
    TransactionConflict if a frame has changed since the transaction read it before, and
    ServerRestarted if the server that it has read from is gone.

    Concurrency: one thread or task at a time.
    """

    def __init__(self, connection: Connection, mapped: MappedTree) -> None:
        """Use `TransformClient.transaction` instead."""
        self._connection = connection
        self._mapped = mapped
        self._instance: str | None = None
        self._versions: dict[str, int] = {}
        self._reads = 0
        self._sets: list[StampedTransform] = []
        self._kind: tuple[str, bool] | None = None  # (authority, static), one per commit

    def __repr__(self) -> str:
        opened = self._connection
        return (
            f"<Transaction of {self._reads} reads and {len(self._sets)} sets at "
            f"{opened.endpoint}, tree {opened.tree!r}, server {self._instance or 'unknown'}, "
            f"{'closed' if self._connection.closed else 'open'}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.commit()

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform`."""
        return self._read(lookups.lookup_transform(target, source, stamp_ns, max_gap_s=max_gap_s))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform_full`."""
        frames = (target, target_stamp_ns, source, source_stamp_ns, fixed_frame)
        return self._read(lookups.lookup_transform_full(*frames, max_gap_s=max_gap_s))

    def can_transform(self, target: str, source: str, stamp_ns: int | None = None) -> bool:
        """As `TransformTree.can_transform`."""
        return self._read(lookups.can_transform(target, source, stamp_ns))

    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform_xact`."""
        return self._read(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`."""
        return self._read(lookups.lookup_latest_transforms_xact(pairs))

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""
        return self._read(lookups.latest_common_time(a, b))

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> None:
        """As `TransformClient.set_transform`, but at the commit.

        All sets of a transaction have the same `authority` and `static`.

        Raises:
            InvalidArgumentException: An earlier set had another `authority` or `static`.

        Example:
            ``tx.set_transform(StampedTransform("map", "cup", now_ns, X_map_cup))``
        """
        self.set_transforms_xact([stamped], authority, static)

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """As `TransformTree.set_transforms_xact`, but at the commit.

        Raises:
            InvalidArgumentException: As for `set_transform`.
        """
        if self._kind not in (None, (authority, static)):
            raise InvalidArgumentException(
                "one transaction has one authority, and its sets are all static or all not",
                field="static" if self._kind and self._kind[1] != static else "authority",
            )
        self._kind = (authority, static)
        self._sets.extend(stampeds)

    def commit(self) -> None:
        """Write the sets atomically, if nothing that was read has changed.

        The end of the `with` block calls it.

        Raises:
            TransactionConflict: A frame changed since this transaction read it.
            ServerRestarted: The server that the transaction read from is gone.
            InvalidArgumentException: A transform is invalid, is older than the server's cache
                time, or would close a cycle.
            LimitExceeded: A limit is reached, such as the number of frames.
            ServiceException: As for every write of the client.
        """
        if self._sets or not self._reads_agree():
            self._send(self._sets)

    def check_reads(self, error: Exception) -> None:
        """Compare what was read with the server's state, and write nothing.

        Args:
            error: What was raised after the reads.

        Raises:
            TransactionConflict: A frame changed since this transaction read it.
        """
        if not self._reads_agree():
            with contextlib.suppress(ServerRestarted, ServerUnavailable, OutcomeUnknown):
                self._send([])

    def _send(self, sets: list[StampedTransform]) -> None:
        authority, static = self._kind or ("", False)
        commit = columns.commit(sets, authority, static)
        commit.read_names = list(self._versions)
        commit.read_versions = np.fromiter(self._versions.values(), np.uint64, len(self._versions))
        self._connection.call(writes.commit(commit, self._instance))

    def _reads_agree(self) -> bool:
        """Whether what was read needs no comparison with the server's state."""
        # A single read is one snapshot by itself; several were taken at different times.
        return self._reads <= 1

    def _read_versions(self, request: Lookup[T]) -> VersionedRead[T]:
        tree = self._mapped.tree
        found = lookups.read_versions(tree, tree.instance, request)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(lookups.with_versions(request), found)

    def _read(self, request: Lookup[T]) -> T:
        instance, versions, answer = self._read_versions(request)
        if self._instance not in (None, instance):
            raise ServerRestarted(
                f"this transaction read from server instance {self._instance}, "
                f"now {instance} serves: run the transaction again",
                value=instance,
            )
        self._instance = instance
        self._reads += 1
        for name, version in versions:
            if self._versions.setdefault(name, version) != version:
                raise TransactionConflict(
                    f"frame {name!r} changed between two reads of the transaction", frame=name
                )
        return answer()


def repeat(
    begin: Callable[[int], Transaction],
    function: Callable[[Transaction], T],
    attempts: int,
) -> T:
    """See `TransformClient.run_transaction`; `begin` makes an attempt, from 1 on."""
    if attempts < 1:
        raise must_be("attempts", "at least 1", attempts)
    pauses = threads.pauses(FIRST_PAUSE_S, LONGEST_PAUSE_S)
    attempt = 1
    while True:
        try:
            with begin(attempt) as transaction:
                try:
                    result = function(transaction)
                except Exception as error:  # it is decided on consistent data
                    transaction.check_reads(error)
                    raise
            return result
        except TransactionConflict as conflict:
            if attempt == attempts:
                conflict.add_note(f"in each of {attempts} attempts")
                raise
        attempt += 1
        time.sleep(random.uniform(0, next(pauses)))
