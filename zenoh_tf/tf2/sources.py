"""Where buffers look up: a tree of their own, or the server of the process's connection."""

from __future__ import annotations

import contextlib
import os
import threading
import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Union

from zenoh_tf import FrameInfo, TransformTree
from zenoh_tf.errors import LookupException

from .parked import parked_lookups
from .wait_loop import WaitLoop

if TYPE_CHECKING:
    from zenoh_tf_client import TransformClient
    from zenoh_tf_client.tf2.connection import Server

#: A tree, and what the two kinds of trees do in different ways.
Source = Union["OwnTree", "Server"]


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
                self._waits, self._process = WaitLoop(lambda: parked_lookups(tree)), os.getpid()
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
    """Connect this process to a server, whose tree all buffers and broadcasters that are made from
    then on share; return the connection if there is one.

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
    client = server().connect(endpoint, tree)
    _connected = True
    return client


def close() -> None:
    """Close the process's connection and all its broadcasters.

    Waiting lookups fail, and message filters drop what they hold. Buffers on the server's tree open
    a new connection at their next use; new ones have a tree of their own until `connect`. A script
    need not call it: connections are closed when the interpreter ends.
    """
    global _connected  # noqa: PLW0603
    _connected = False
    server().close()


def server() -> Server:
    """Return the server of the process's connection, without connecting."""
    from zenoh_tf_client.tf2.connection import SERVER  # noqa: PLC0415 - only this needs the SDK

    return SERVER


def connected() -> Server | None:
    """Return the server if this process has called `connect`."""
    return server() if _connected else None
