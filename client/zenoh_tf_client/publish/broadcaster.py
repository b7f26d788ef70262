"""`Broadcaster`: publishes transforms without waiting for a reply, as sensors need it."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable
from typing import TYPE_CHECKING

from zenoh_tf import StampedTransform
from zenoh_tf._net import keys
from zenoh_tf._zenoh.calls import is_forked, raise_if_forked
from zenoh_tf.errors import ServerUnavailable

from ..session.connection import Connection
from .announcer import Announcer
from .publisher import Publisher, message

if TYPE_CHECKING:
    from typing_extensions import Self


class Broadcaster:
    """Publishes transforms as one authority; made by `TransformClient.broadcaster`.

    One call sends one message, whose good transforms the server commits at one instant. The server
    sends no reply: it logs and counts what it rejects. The broadcaster keeps its static transforms
    and announces them to every new server, which leaves out those that a call or another authority
    has changed or removed since. A call returns at once, unless the network takes no more: then a
    sensor that outruns it waits. A context manager, which closes itself at the end.

    Thread safety: all methods.
    """

    def __init__(
        self, connection: Connection, authority: str, open_broadcasters: set[Broadcaster]
    ) -> None:
        """Declare the publishers, and be in `open_broadcasters` until the end.

        Raises:
            InvalidArgumentException: `authority` is too long or not valid UTF-8.
            ServerUnavailable: The connection is closed.
            AccessDenied: The server's access rules do not allow to publish as `authority`.
        """
        connection.check_publish(authority)
        self._authority = authority
        self._connection = connection
        self._lock = threading.Lock()
        self._announcer: Announcer | None = None  # once there are static transforms
        self._closed = False
        self._dynamic_publisher = self._publisher(static=False)
        self._static_publisher = self._publisher(static=True)
        # A weak reference: otherwise the two would be collected later than the client.
        self._open_broadcasters = weakref.ref(open_broadcasters)
        open_broadcasters.add(self)

    def __repr__(self) -> str:
        state = "closed" if self._closed or self._connection.closed else "open"
        statics = 0 if self._announcer is None else len(self._announcer)
        return (
            f"<Broadcaster {self._authority!r} at {self._connection.endpoint}, "
            f"tree {self._connection.tree!r}, {statics} static, {state}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def authority(self) -> str:
        """Returns the name that this broadcaster publishes as."""
        return self._authority

    def send(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms at their stamps, without waiting for the server.

        The server drops transforms that are older than its cache time.

        Args:
            stampeds: One transform or several, each ``X_parent_child``: it maps coordinates in
                the child frame to coordinates in the parent frame. Metres; nanoseconds. Those
                of several that the server accepts are committed at one instant.

        Raises:
            InvalidArgumentException: `stampeds` holds anything but StampedTransforms.
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send(StampedTransform("odom", "base", time.time_ns(), X_odom_base))``
        """
        self._dynamic_publisher.put(message(stampeds))

    def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold at all times, now and to every new server later.

        Like every put they may be lost with the connection; `TransformClient.set_transform`
        says whether a transform has arrived.

        Args:
            stampeds: One transform or several, each ``X_parent_child`` as in `send`. Their
                stamps do not matter. A newer transform of a child frame replaces the older one.

        Raises:
            InvalidArgumentException: `stampeds` holds anything but StampedTransforms.
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send_static(StampedTransform("base", "camera", 0, X_base_camera))``
        """
        raise_if_forked()
        with self._lock:
            if self._closed:
                raise ServerUnavailable("the broadcaster is closed")
            if self._announcer is None:
                self._announcer = Announcer(self._connection, self._static_publisher)
            announcer = self._announcer
        announcer.send(list(stampeds) if isinstance(stampeds, Iterable) else [stampeds])

    def close(self) -> None:
        """Stop publishing. What was sent stays in the server. May be called again."""
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
        key = keys.put(self._connection.tree, self._authority, static=static)
        return Publisher(self._connection, key)
