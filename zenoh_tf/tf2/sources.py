"""Where buffers look up: a tree of their own, or the server of the process's connection."""

from __future__ import annotations

import contextlib
import os
import threading
import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from zenoh_tf import FrameInfo, StampedTransform, TransformTree
from zenoh_tf.errors import LookupException

from .parked import parked_lookups
from .topics import Send
from .wait_loop import WaitLoop

if TYPE_CHECKING:
    from zenoh_tf_client import TransformClient


class Tree(Protocol):
    """What buffers call: `TransformTree` and `TransformClient` have it."""

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform`."""

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> StampedTransform:
        """As `TransformTree.lookup_transform_full`."""

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> bool:
        """As `TransformTree.set_transform`."""

    def clear(self) -> None:
        """As `TransformTree.clear`."""


class Source(Protocol):
    """A tree, and what the two kinds of trees do in different ways."""

    def tree(self) -> Tree:
        """Return the tree; connect if need be. Raises the service's errors."""

    def waits(self) -> WaitLoop:
        """Return the loop on which lookups wait. Raises as `tree`."""

    def frames(self) -> list[FrameInfo]:
        """Return what is known about every frame. Raises as `tree`."""


class Server(Source, Protocol):
    """The server of the process's connection."""

    def publisher(self, authority: str, *, static: bool) -> Send:
        """Return what publishes to it. Raises as `tree`."""


class OwnTree:
    """A buffer's own tree. Thread safety: all methods."""

    def __init__(self, tree: TransformTree) -> None:
        self._tree = tree
        self._lock = threading.Lock()
        self._waits: WaitLoop | None = None  # once a lookup waits
        self._process = 0  # that started it: a forked one needs a loop of its own

    def tree(self) -> TransformTree:
        """Return the tree."""
        return self._tree

    def waits(self) -> WaitLoop:
        """Return the loop on which lookups wait; it ends with this object.

        Raises ServiceException if the process has no thread or file left for it.
        """
        with self._lock:
            if self._waits is None or self._process != os.getpid():
                tree = self._tree
                self._waits = WaitLoop(lambda: parked_lookups(tree))
                self._process = os.getpid()
                weakref.finalize(self, self._waits.close).atexit = False
            return self._waits

    def frames(self) -> list[FrameInfo]:
        """Return what is known about every frame."""
        found = []
        for name in self._tree.frames():
            with contextlib.suppress(LookupException):  # removed since its name was listed
                found.append(self._tree.frame(name))
        return found


_connected = False  # by `connect`: what is made from then on is on the server


def connect(
    endpoint: str | Sequence[str] | None = None, tree: str | None = None
) -> TransformClient:
    """Connect this process to a server; return its connection if it has one.

    Buffers and broadcasters that are made from then on are on the server's tree. Scripts for tf2
    name no server, because theirs is whatever is on /tf. So each process has one connection, and
    a script calls this before it makes anything else.

    Args:
        endpoint: Where the server listens, or several such endpoints as for
            `TransformClient.connect`; None for ZENOH_TF_CONNECT, else the SDK's default.
        tree: The name of the tree; None for ZENOH_TF_TREE, else the SDK's default.

    Returns:
        The client that all buffers and broadcasters use.

    Raises:
        ServerUnavailable: No server answers. The next call tries again.
        AccessDenied: The server does not let this process in.
        InvalidArgumentException: The open connection has another endpoint or tree.
    """
    global _connected  # noqa: PLW0603
    from zenoh_tf_client.tf2 import connection  # noqa: PLC0415 - what needs no server needs no SDK

    client = connection.connect(endpoint, tree)
    _connected = True
    return client


def close() -> None:
    """Close the process's connection and all its broadcasters.

    Waiting lookups fail, and message filters drop what they hold. Buffers on the server's tree open
    a new connection at their next use; new ones have a tree of their own until `connect`. A script
    need not call it: connections are closed when the interpreter ends.
    """
    global _connected  # noqa: PLW0603
    from zenoh_tf_client.tf2 import connection  # noqa: PLC0415

    _connected = False
    connection.close()


def server() -> Server:
    """Return the server of the process's connection, without connecting."""
    from zenoh_tf_client.tf2 import connection  # noqa: PLC0415

    return connection.SERVER


def connected() -> Server | None:
    """Return the server if this process has called `connect`."""
    return server() if _connected else None
