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
from types import TracebackType
from typing import Self, TypeVar

import numpy as np

from zenoh_tf import LatestTransform, StampedTransform
from zenoh_tf.errors import (
    InvalidArgumentException,
    OutcomeUnknown,
    ServerRestarted,
    ServerUnavailable,
    TransactionConflict,
)

from .requests import columns, lookups, writes
from .requests.request import Read, Rows, VersionedRead
from .session.connection import Connection
from .session.shared_reads import SharedReads

T = TypeVar("T")

#: The pause between attempts is random, up to a bound that doubles (exponential backoff).
FIRST_PAUSE_S = 0.001
LONGEST_PAUSE_S = 0.1


class Transaction:
    """One attempt at a read-modify-write; made by `TransformClient.transaction`.

    A context manager: the end of the block commits, unless an exception ends it. Reads do not see
    the transaction's own sets.

    Thread safety: one thread at a time.
    """

    def __init__(self, connection: Connection, reads: SharedReads) -> None:
        """Use `TransformClient.transaction` instead.

        Args:
            connection: The connection to read and commit on.
            reads: How the connection's client reads.
        """
        self._connection = connection
        self._shared = reads
        self._instance: str | None = None
        self._versions: dict[str, int] = {}
        self._reads = 0
        self._sets: list[StampedTransform] = []
        self._kind: tuple[str, bool] | None = None  # (authority, static), one per commit

    def __repr__(self) -> str:
        return (
            f"<Transaction of {self._reads} reads and {len(self._sets)} sets at "
            f"{self._connection.endpoint}, tree {self._connection.tree!r}, "
            f"server {self._instance or 'unknown'}, "
            f"{'closed' if self._connection.closed else 'open'}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.commit()

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None
    ) -> StampedTransform:
        """Look up the pose of `source` in `target` at a time, interpolated.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.

        Returns:
            ``X_target_source``: it maps coordinates in `source` to coordinates in `target`, in
            metres. Its ``stamp_ns`` is the time that was used.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name or stamp makes no sense.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.
        """
        return self._read(lookups.lookup_transform(target, source, stamp_ns))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
    ) -> StampedTransform:
        """Look up the pose of `source` at one time in `target` at another time.

        Args:
            target: The frame to express the pose in.
            target_stamp_ns: The time of `target` in nanoseconds; None for the latest common time
                of `target` and `fixed_frame`.
            source: The frame whose pose is asked for.
            source_stamp_ns: The time of `source` in nanoseconds; None for the latest common time
                of `source` and `fixed_frame`.
            fixed_frame: The frame that is taken not to move between the two times.

        Returns:
            ``X_target_source`` from `source` at `source_stamp_ns` to `target` at
            `target_stamp_ns`, in metres, stamped `target_stamp_ns`.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name or stamp makes no sense.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.
        """
        return self._read(
            lookups.lookup_transform_full(
                target, target_stamp_ns, source, source_stamp_ns, fixed_frame
            )
        )

    def can_transform(self, target: str, source: str, stamp_ns: int | None = None) -> bool:
        """Tell whether `lookup_transform` with the same arguments would succeed.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time.

        Returns:
            True if the lookup would succeed, False if it would raise an error of the tree.

        Raises:
            InvalidArgumentException: `stamp_ns` is not a 64-bit integer.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.
        """
        return self._read(lookups.can_transform(target, source, stamp_ns))

    def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        """Look up the pose of `source` in `target` from the newest samples, in one snapshot.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            ``X_target_source`` in metres, the oldest stamp among the samples used (``stamp_ns``)
            and the newest one (``newest_stamp_ns``).

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name or stamp makes no sense.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.

        Example:
            ``X_map_cup = tx.lookup_latest_transform_xact("map", "cup").transform``
        """
        return self._read(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        """Look up several latest poses in one atomic snapshot.

        Args:
            pairs: (target, source) frames of each pose.

        Returns:
            For each pair what `lookup_latest_transform_xact` returns, in order.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name or stamp makes no sense.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.
        """
        return self._read(lookups.lookup_latest_transforms_xact(pairs))

    def latest_common_time(self, a: str, b: str) -> int | None:
        """Return the newest time that every link between two frames can serve.

        Args:
            a: One frame.
            b: The other frame.

        Returns:
            The time in nanoseconds; None if all links between the frames are static.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name or stamp makes no sense.
            TransactionConflict: A frame changed since this transaction read it before.
            ServerRestarted: The server that the transaction read from is gone.
            ServerUnavailable: No server answered in time, or the client is closed.
            LimitExceeded: A limit of the server was hit, such as its backlog of requests.
            ProtocolError: The reply is malformed.
        """
        return self._read(lookups.latest_common_time(a, b))

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> None:
        """Add a transform to what the commit writes.

        Args:
            stamped: ``X_parent_child``: it maps coordinates in the child frame to coordinates in
                the parent frame. Metres; nanoseconds.
            authority: The name to publish as; the same for all sets of a transaction.
            static: True for a transform that holds at all times; the same for all sets.

        Raises:
            InvalidArgumentException: An earlier set had another `authority` or `static`.

        Example:
            ``tx.set_transform(StampedTransform("map", "cup", now_ns, X_map_cup))``
        """
        self.set_transforms_xact([stamped], authority, static)

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """Add transforms to what the commit writes.

        Args:
            stampeds: Transforms, each ``X_parent_child`` as in `set_transform`.
            authority: The name to publish as; the same for all sets of a transaction.
            static: True for transforms that hold at all times; the same for all sets.

        Raises:
            InvalidArgumentException: An earlier set had another `authority` or `static`.
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
            InvalidArgumentException: A transform makes no sense, is older than the server's cache
                time, or would close a cycle.
            LimitExceeded: A limit was hit, such as the number of frames.
            ServerUnavailable: No server answered, and nothing was written.
            OutcomeUnknown: No reply came; the commit may or may not have been applied.
            ProtocolError: The reply is malformed.
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
        # A single read of the server is one snapshot by itself; several were taken at different
        # times, and one of a replica may be old.
        most = 0 if self._connection.reads_may_be_old else 1
        return self._reads <= most

    def _read_versions(self, request: Read[T] | Rows[T]) -> VersionedRead[T]:
        return self._shared.read_versions(request)

    def _read(self, request: Read[T] | Rows[T]) -> T:
        instance, versions, answer = self._read_versions(request)
        if self._instance not in (None, instance):
            raise ServerRestarted(
                f"this transaction read from server instance {self._instance}, "
                f"now {instance} serves",
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


def run_transaction(
    connection: Connection,
    reads: SharedReads,
    function: Callable[[Transaction], T],
    attempts: int,
) -> T:
    """See `TransformClient.run_transaction`."""
    return repeat(lambda: Transaction(connection, reads), function, attempts)


def repeat(
    begin: Callable[[], Transaction],
    function: Callable[[Transaction], T],
    attempts: int,
) -> T:
    """As `run_transaction`, with transactions that `begin` makes."""
    if attempts < 1:
        raise InvalidArgumentException(
            f"attempts must be at least 1, not {attempts}", field="attempts"
        )
    longest_s = FIRST_PAUSE_S
    attempt = 1
    while True:
        try:
            with begin() as transaction:
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
        time.sleep(random.uniform(0, longest_s))
        longest_s = min(2 * longest_s, LONGEST_PAUSE_S)
