"""`Mirror`: a copy of the server's tree in this process, kept up to date by its stream."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeVar

from zenoh_tf import Explanation, LatestTransform, TransformTree, unix, wire
from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import ServerRestarted, ServerUnavailable, TimeoutException, must_be
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.text import quoted
from zenoh_tf.text.times import age

from ..requests import lookups
from ..requests.receipt import Receipt
from ..requests.request import Request
from ..session.connection import Connection
from ..session.mapped_tree import MappedTree
from ..transaction import Transaction, repeat
from .interest import interested
from .reads import OF_TREE, MirrorReads
from .source import MirrorSource
from .transaction import MirrorTransaction, OwnWrites

if TYPE_CHECKING:
    from typing_extensions import Self

T = TypeVar("T")

#: A mirror that has not heard of its server for longer is disconnected; with a rate, its period is
#: added.
_SILENT_S: Final = 2.0

_all: Final[weakref.WeakSet[Mirror]] = weakref.WeakSet()


class Mirror(MirrorReads):
    """A copy of the server's tree in this process; made by `TransformClient.mirror`.

    Its lookups are as fast as those of an embedded tree, and send no message. What they read is
    always a state that the server's tree has had: the commits up to `seq`, each as a whole, and
    none after it. `age_s` says how old that state may be. Several lookups may see several such
    states, but never go back while the same server runs. Writes go to the server, as always.

    It has the lookups of `TransformTree`, with the same arguments, results and errors, and
    ServerUnavailable once it is closed; `frames` are in any order, and a `frame` lacks its last
    change.

    While the server is away, or the link is cut, the last state is served and its age grows.
    The contract: docs/how-to/mirrors.md. A context manager, which closes itself at the end.

    Thread safety: all methods.

    Example:
        ``with tf.mirror() as m: print(m.lookup_transform("map", "base"), m.age_s)``
    """

    def __init__(
        self,
        connection: Connection,
        mapped: MappedTree,
        timeout_s: float,
        interest: wire.Interest | None,
    ) -> None:
        """Use `TransformClient.mirror` instead."""
        if not 0 < timeout_s < 1e6:
            raise must_be("timeout_s", "positive", timeout_s)
        self._connection = connection
        self._mapped = mapped
        self._interest = interest
        self._silent_s = _SILENT_S + (interest.period_ns / 1e9 if interest else 0.0)
        weak_self = weakref.ref(self)  # else the feed's thread would keep the mirror alive

        def on_copy(tree: TransformTree | None, instance: str) -> None:
            mirror = weak_self()
            if mirror is not None:
                mirror._install(tree)

        source = MirrorSource(connection, interest)
        self._feed = feed = MirrorFeed(source, on_copy, interest)
        source.feed = feed
        connection.add_user(feed)
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

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable. May be called again."""
        self._feed.close()
        self._install(None)

    @property
    def age_s(self) -> float:
        """Returns how old what is read may be, in seconds.

        An upper bound: all that the server had committed this long ago can be read. At most about
        one round trip too high. An idle server sends a heartbeat every 0.1 s. Infinite if the
        mirror is closed.
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

        A lost connection is noticed after some seconds: `age_s` shows it sooner.
        """
        return self._feed.state.synced and self._feed.silent_at != self._feed.heard

    @property
    def instance(self) -> str:
        """Returns the id of the server instance whose state is read."""
        return self._feed.state.instance

    def wait_for(self, receipt: Receipt | None = None, timeout_s: float = 5.0) -> None:
        """Wait until what a client has written can be read here.

        Args:
            receipt: Its `last_receipt` after the write, also of another process; None for all that
                this mirror's own client has written so far.
            timeout_s: How long to wait, in seconds.

        Raises:
            TimeoutException: The mirror has not received it in time.
            ServerRestarted: It was written to another server instance than the mirror follows.
            ServerUnavailable: The mirror is closed.

        Example:
            ``tf.set_transform(stamped); m.wait_for()``
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

    # --- lookups that may ask the server

    def lookup_latest_transform(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform`, or by query.

        Args:
            max_age_s: How old the mirror's state may be, in seconds; if it is older, the server is
                asked. None for any age.

        Raises:
            ServerUnavailable: The mirror is closed, or the server was asked and did not answer.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform(target, source)
        return self._ask(lookups.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(
        self, target: str, source: str, max_age_s: float | None = None
    ) -> LatestTransform:
        """As `TransformTree.lookup_latest_transform_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return (self._current or self._tree).lookup_latest_transform_xact(target, source)
        return self._ask(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]], max_age_s: float | None = None
    ) -> list[LatestTransform]:
        """As `TransformTree.lookup_latest_transforms_xact`, or by query.

        Args:
            max_age_s: As for `lookup_latest_transform`, in seconds.
        """
        if max_age_s is None or self._feed.age_s() <= max_age_s:
            return self._tree.lookup_latest_transforms_xact(pairs)
        return self._ask(lookups.lookup_latest_transforms_xact(pairs))

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `TransformTree.explain`, also if the mirror does not hear its server."""
        found, age_s = self._tree.explain(target, source, stamp_ns), self.age_s
        if age_s < self._silent_s:
            return found
        return replace(
            found,
            reasons=(
                *found.reasons,
                f"The mirror is disconnected from its server for {age(round(age_s * 1e9))}, and "
                "its last poses are read.",
            ),
            advice=(*found.advice, "Check that the server runs, and the network to it."),
        )

    gate = TransformTree.gate
    """As `TransformTree.gate`, which looks up in the mirror."""

    def run_transaction(self, function: Callable[[Transaction], T], attempts: int = 10) -> T:
        """As `TransformClient.run_transaction`, with reads in the mirror: one round trip.

        The server compares what was read with its own state, so the transaction is strictly
        serializable, however old the mirror is. A read waits for what this mirror's transactions
        have written to the same frames; after a conflict, the next attempt waits for the state that
        the last one was in conflict with.

        Example:
            ``m.run_transaction(lift)``
        """
        raise_if_forked()

        def begin(attempt: int) -> Transaction:
            own = (self._feed, self._own_writes, self._interest)
            return MirrorTransaction(self._connection, self._mapped, *own, attempt)

        return repeat(begin, function, attempts)

    def _ask(self, request: Request[T]) -> T:
        raise_if_forked()
        return self._connection.call(request)

    def _now_ns(self) -> int:
        return self._feed.clock.real_ns()

    def _install(self, tree: TransformTree | None) -> None:
        """Read in another tree, or in none; see `reads`."""
        if tree is not None and self._interest is not None:
            tree = interested(tree, self._interest)
        self._current = tree
        for name in OF_TREE:
            if tree is None:
                self.__dict__.pop(name, None)
            else:
                self.__dict__[name] = getattr(tree, name)


def _after_fork() -> None:
    """In a forked child a lookup would wait for ever for a thread that only the parent has."""
    for mirror in list(_all):
        mirror._install(None)


unix.after_fork(_after_fork)
