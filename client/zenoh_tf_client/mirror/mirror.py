"""`Mirror`: a copy of the server's tree in this process, kept up to date by the commit stream."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeVar

from zenoh_tf import LatestTransform, TransformTree, wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    ServerRestarted,
    ServerUnavailable,
    TimeoutException,
)
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.text import quoted

from ..requests import lookups
from ..requests.receipt import Receipt
from ..requests.request import Request
from ..session.calls import raise_if_forked
from ..session.connection import Connection
from ..session.shared_reads import SharedReads
from ..transaction import Transaction, repeat
from .interest import interested
from .reads import TAKEN, MirrorReads
from .source import MirrorSource
from .transaction import CATCH_UP_S, MirrorTransaction, OwnWrites, reads_by_query

T = TypeVar("T")

_all: weakref.WeakSet[Mirror] = weakref.WeakSet()


class Mirror(MirrorReads):
    """A copy of the server's tree in this process; made by `TransformClient.mirror`.

    Its lookups are as fast as those of an embedded tree, and send no message. What they read is
    always a state that the server's tree has had: the commits up to `seq`, each as a whole, and
    none after it. `age_s` says how old that state may be. Several lookups may see several such
    states, but never go back while the same server runs. Writes go to the server, as always.

    While the server is away, or the link is cut, the last state is served and its age grows.
    docs/mirrors.md has the whole contract. A context manager, which closes itself at the end.

    Thread safety: all methods.

    Example:
        ``with tf.mirror() as m: print(m.lookup_transform("map", "base"), m.age_s)``
    """

    def __init__(
        self,
        connection: Connection,
        reads: SharedReads,
        timeout_s: float,
        interest: wire.Interest | None = None,
    ) -> None:
        """Use `TransformClient.mirror` instead.

        Args:
            connection: The connection to the server.
            reads: How transactions read that do not read here.
            timeout_s: How long to wait for the first copy, in seconds.
            interest: What to follow; None for everything.

        Raises:
            ServerUnavailable: See `TransformClient.mirror`, also for the others.
            AccessDenied: The same.
            TimeoutException: The same.
            LimitExceeded: The same.
            InvalidArgumentException: The same.
        """
        if not 0 < timeout_s < 1e6:
            raise InvalidArgumentException(
                f"timeout_s must be positive, not {timeout_s!r}", field="timeout_s"
            )
        self._connection = connection
        self._reads = reads
        self._interest = interest
        self._current: TransformTree | None = None  # None: closed, or forked
        weak_self = weakref.ref(self)  # else the feed's thread would keep the mirror alive

        def on_copy(tree: TransformTree | None, instance: str) -> None:
            mirror = weak_self()
            if mirror is not None:
                mirror._take(tree)

        self._feed = feed = MirrorFeed(MirrorSource(connection, interest), on_copy, interest)
        self._own_writes = OwnWrites(feed)
        # One that nobody holds any more is closed. At exit, its connection is.
        weakref.finalize(self, feed.close).atexit = False
        _all.add(self)
        try:
            feed.wait_for_copy(timeout_s)
        except BaseException:
            feed.close()
            raise

    def __repr__(self) -> str:
        state = self._feed.state
        return (
            f"<Mirror of tree {self._connection.tree!r}, server {state.instance or 'unknown'}, "
            f"seq {state.seq}, {'closed' if state.tree is None else 'open'}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable. May be called again."""
        self._feed.close()
        self._take(None)

    # --- what it has

    @property
    def age_s(self) -> float:
        """Returns how old what is read may be, in seconds.

        All that the server had committed this long ago can be read. The value is never too small,
        and too large by a round trip to the server at most. A server that has nothing to do tells
        so every 0.1 s. Infinite if the mirror is closed.
        """
        return self._feed.age_s()

    @property
    def seq(self) -> int:
        """Returns the number of a commit: it and all before it can be read.

        Numbers of different server instances cannot be compared.
        """
        return self._feed.state.seq

    @property
    def synced(self) -> bool:
        """Returns True if the mirror knows of nothing that it lacks.

        A lost connection is noticed late: `age_s` tells more.
        """
        return self._feed.state.synced

    @property
    def instance(self) -> str:
        """Returns the id of the server instance whose state is read."""
        return self._feed.state.instance

    def wait_for(self, receipt: Receipt | None = None, timeout_s: float = 5.0) -> None:
        """Wait until what a client has written can be read here.

        Args:
            receipt: Its `TransformClient.last_receipt` after the write, also of another process;
                None for all that this mirror's own client has written so far.
            timeout_s: How long to wait, in seconds.

        Raises:
            TimeoutException: The mirror has not received it in time.
            ServerRestarted: It was written to another server instance than the mirror follows.
            ServerUnavailable: The mirror is closed.

        Example:
            ``tf.set_transform(stamped); m.wait_for(); m.lookup_transform("map", "base")``
        """
        raise_if_forked()
        awaited = receipt or self._connection.last_receipt
        feed = self._feed
        if awaited is None or feed.state.has(awaited.instance, awaited.seq):
            return
        if feed.wait(lambda: feed.state.has(awaited.instance, awaited.seq), timeout_s):
            return
        state = feed.state
        if state.tree is None:
            raise ServerUnavailable("the mirror is closed")
        if state.instance != awaited.instance:
            raise ServerRestarted(
                f"the write was to server instance {quoted(awaited.instance)}, but the mirror "
                f"follows {quoted(state.instance)}",
                value=awaited.instance,
            )
        raise TimeoutException(
            f"the mirror has not received commit {awaited.seq} within {timeout_s:g} s: it is at "
            f"{state.seq}"
        )

    # --- lookups beside those of MirrorReads

    def lookup_latest_transform(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform`, or a lookup by query.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            max_age_s: How old the mirror's state may be, in seconds; if it is older, the server is
                asked. None for any age.

        Returns:
            ``X_target_source`` in metres, as `TransformClient.lookup_latest_transform`.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is invalid.
            ServerUnavailable: The mirror is closed, or the server was asked and did not answer.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform(target, source)
        return self._ask(lookups.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform_xact`, or a lookup by query.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            max_age_s: As for `lookup_latest_transform`, in seconds.

        Returns:
            ``X_target_source`` in metres, as `TransformClient.lookup_latest_transform_xact`.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is invalid.
            ServerUnavailable: The mirror is closed, or the server was asked and did not answer.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform_xact(target, source)
        return self._ask(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]], max_age_s: float | None = None
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`, or a lookup by query.

        Args:
            pairs: (target, source) frames of each pose.
            max_age_s: As for `lookup_latest_transform`, in seconds.

        Returns:
            For each pair what `lookup_latest_transform_xact` returns, in order.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is invalid.
            ServerUnavailable: The mirror is closed, or the server was asked and did not answer.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return self._tree.lookup_latest_transforms_xact(pairs)
        return self._ask(lookups.lookup_latest_transforms_xact(pairs))

    def run_transaction(self, function: Callable[[Transaction], T], attempts: int = 10) -> T:
        """As `TransformClient.run_transaction`, with reads in the mirror: one round trip.

        The server compares what was read with its own state, so the transaction is strictly
        serializable, however old the mirror is. A read waits for what this mirror's transactions
        have written to the same frames; after a conflict, the next attempt waits for the state that
        the last one was in conflict with.

        Args:
            function: Reads and sets through the transaction. It may be called several times.
            attempts: How often to call it at most.

        Returns:
            What `function` returned in the attempt that was committed.

        Raises:
            TransactionConflict: Others changed what was read, in every attempt.
            TransformException: `function` or the commit failed; see `Transaction.commit`.

        Example:
            ``m.run_transaction(lambda tx: tx.set_transform(lifted(tx)))``
        """
        attempt = 0

        def begin() -> Transaction:
            nonlocal attempt
            attempt += 1
            return self._transaction(attempt)

        return repeat(begin, function, attempts)

    def _transaction(self, attempt: int) -> Transaction:
        """A transaction that reads here; after a conflict, once the mirror has what it was in
        conflict with. If that takes long, it reads by query."""
        raise_if_forked()
        interest = self._interest
        if reads_by_query(interest, attempt):
            return Transaction(self._connection, self._reads)
        if attempt > 1:
            try:
                self.wait_for(timeout_s=CATCH_UP_S)
            except (TimeoutException, ServerRestarted):
                return Transaction(self._connection, self._reads)
        state = self._feed.state
        if state.tree is None:
            raise ServerUnavailable("the mirror is closed")
        return MirrorTransaction(
            self._connection, self._reads, state.tree, state.instance, self._own_writes, interest
        )

    # --- where it reads

    @property
    def _tree(self) -> TransformTree:
        tree = self._current
        if tree is None:
            raise_if_forked()
            raise ServerUnavailable("the mirror is closed")
        return tree

    def _ask(self, request: Request[T]) -> T:
        raise_if_forked()
        return self._connection.call(request)

    def _take(self, tree: TransformTree | None) -> None:
        """Read in another tree, or in none; see `reads`."""
        if tree is not None and self._interest is not None:
            tree = interested(tree, self._interest)
        self._current = tree
        for name in TAKEN:
            if tree is None:
                self.__dict__.pop(name, None)
            else:
                self.__dict__[name] = getattr(tree, name)


def _after_fork() -> None:
    """In a forked child a lookup would wait for ever for a thread that only the parent has."""
    for mirror in list(_all):
        mirror._take(None)


os.register_at_fork(after_in_child=_after_fork)
