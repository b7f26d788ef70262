"""The base of `Mirror`: its copy, and how old that is."""

from __future__ import annotations

import weakref
from typing import ClassVar, Final

from zenoh_tf import TransformTree, unix, wire
from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import ServerRestarted, ServerUnavailable, TimeoutException, must_be
from zenoh_tf.mirrors.feed import MirrorFeed
from zenoh_tf.text import quoted

from ..requests.receipt import Receipt
from ..session.connection import Connection
from .interest import interested
from .reads import PLAIN, WAITING, MirrorReads
from .source import MirrorSource
from .transaction_reads import OwnWrites

#: A mirror that has not heard of its server for longer is disconnected; with a rate, its period is
#: added.
_SILENT_S: Final = 2.0

_all: Final[weakref.WeakSet[BaseMirror]] = weakref.WeakSet()


class BaseMirror(MirrorReads):
    """A copy of the server's tree, and its lookups. Thread safety: all methods."""

    #: The methods of its tree that it has as attributes.
    _taken: ClassVar[tuple[str, ...]] = (*WAITING, *PLAIN)

    def __init__(
        self, connection: Connection, timeout_s: float, interest: wire.Interest | None
    ) -> None:
        """Wait for the first copy; see `TransformClient.mirror` for the errors."""
        if not 0 < timeout_s < 1e6:
            raise must_be("timeout_s", "positive", timeout_s)
        self._tree_name = connection.tree
        self._interest = interest
        self._silent_s = _SILENT_S + (interest.period_ns / 1e9 if interest else 0.0)
        self._current: TransformTree | None = None  # None: closed, or forked
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
            f"<{type(self).__name__} of tree {self._tree_name!r}, "
            f"server {state.instance or 'unknown'}, "
            f"seq {state.seq}, {'closed' if state.tree is None else 'open'}>"
        )

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

    def _wait_until(self, receipt: Receipt | None, timeout_s: float) -> None:
        """Wait until a write can be read here; see `Mirror.wait_for` for the errors."""
        raise_if_forked()
        feed = self._feed
        if receipt is None or feed.state.has(receipt.instance, receipt.seq):
            return
        if feed.wait(lambda: feed.state.has(receipt.instance, receipt.seq), timeout_s):
            return
        state = feed.state
        if state.tree is None:
            raise ServerUnavailable("the mirror is closed")
        if state.instance != receipt.instance:
            raise ServerRestarted(
                f"the write was to server instance {quoted(receipt.instance)}, but the mirror "
                f"follows {quoted(state.instance)}",
                value=receipt.instance,
            )
        raise TimeoutException(
            f"the mirror has not received commit {receipt.seq} within {timeout_s:g} s: it is at "
            f"{state.seq}"
        )

    def _has(self, receipt: Receipt) -> bool:
        return self._feed.state.has(receipt.instance, receipt.seq)

    def _end(self) -> None:
        """Stop following the server. Lookups then raise ServerUnavailable."""
        self._feed.close()
        self._install(None)

    @property
    def _tree(self) -> TransformTree:
        tree = self._current
        if tree is None:
            raise_if_forked()
            raise ServerUnavailable("the mirror is closed")
        return tree

    def _now_ns(self) -> int:
        return self._feed.clock.real_ns()

    def _install(self, tree: TransformTree | None) -> None:
        """Read in another tree, or in none; see `reads`."""
        if tree is not None and self._interest is not None:
            tree = interested(tree, self._interest)
        self._current = tree
        for name in self._taken:
            if tree is None:
                self.__dict__.pop(name, None)
            else:
                self.__dict__[name] = getattr(tree, name)


def _after_fork() -> None:
    """In a forked child a lookup would wait for ever for a thread that only the parent has."""
    for mirror in list(_all):
        mirror._install(None)


unix.after_fork(_after_fork)
