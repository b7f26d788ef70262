"""What the broadcasters of both clients share: all but how a caller waits.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable
from typing import Any

from zenoh_tf import StampedTransform
from zenoh_tf._net import keys
from zenoh_tf.errors import ServerUnavailable

from ..session.calls import is_forked, raise_if_forked
from ..session.connection import Connection
from .announcer import Announcer
from .publisher import Publisher


class Publishing:
    """Publishes as one authority, and keeps its static transforms."""

    def __init__(self, connection: Connection, authority: str, open_broadcasters: set[Any]) -> None:
        """Declare the publishers, and be in `open_broadcasters` until the end.

        Raises:
            InvalidArgumentException: `authority` is too long or not valid UTF-8.
            ServerUnavailable: The connection is closed.
            AccessDenied: The server's access rules do not allow to publish as `authority`.
        """
        connection.check_publish(authority)
        self._authority = authority
        self._opened = connection
        self._lock = threading.Lock()
        self._announcer: Announcer | None = None  # once there are static transforms
        self._closed = False
        self._dynamic_publisher = self._publisher(static=False)
        self._static_publisher = self._publisher(static=True)
        # A weak reference: otherwise the two would be collected later than the client.
        self._open_broadcasters = weakref.ref(open_broadcasters)
        open_broadcasters.add(self)

    def __repr__(self) -> str:
        state = "closed" if self._closed or self._opened.closed else "open"
        statics = 0 if self._announcer is None else len(self._announcer)
        return (
            f"<{type(self).__name__} {self._authority!r} at {self._opened.endpoint}, "
            f"tree {self._opened.tree!r}, {statics} static, {state}>"
        )

    @property
    def authority(self) -> str:
        """Returns the name that this broadcaster publishes as."""
        return self._authority

    def _put_static(self, rows: list[StampedTransform]) -> None:
        raise_if_forked()
        with self._lock:
            if self._closed:
                raise ServerUnavailable("the broadcaster is closed")
            if self._announcer is None:
                self._announcer = Announcer(self._opened, self._static_publisher)
            announcer = self._announcer
        announcer.send(rows)

    def _end(self) -> None:
        """Undeclare the publishers. May be called again."""
        if is_forked():
            return
        with self._lock:
            if self._closed:
                return
            self._closed = True
            announcer = self._announcer
        if announcer is not None:
            announcer.close()
        self._dynamic_publisher.undeclare()
        self._static_publisher.undeclare()
        open_broadcasters = self._open_broadcasters()
        if open_broadcasters is not None:
            open_broadcasters.discard(self)

    def _publisher(self, *, static: bool) -> Publisher:
        key = keys.put(self._opened.tree, self._authority, static=static)
        return Publisher(self._opened, key)


def rows_of(stampeds: StampedTransform | Iterable[StampedTransform]) -> list[StampedTransform]:
    """The rows of one message."""
    return [stampeds] if isinstance(stampeds, StampedTransform) else list(stampeds)
