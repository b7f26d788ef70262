"""`Broadcaster`: publishes transforms without waiting for a reply, as sensors need it."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/broadcaster.py: edit that.

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from zenoh_tf import StampedTransform

from ..session.connection import Connection
from .publisher import message
from .publishing import Publishing, rows_of


class Broadcaster(Publishing):
    """Publishes transforms as one authority; made by `TransformClient.broadcaster`.

    One call sends one message, which the server commits atomically. The server sends no reply: it
    logs and counts what it rejects. The broadcaster keeps its static transforms and announces
    them to every new server, which leaves out those that a call or another authority has changed
    or removed since. A context manager, which closes itself at the end.

    Thread safety: all methods.
    """

    def __init__(
        self, connection: Connection, authority: str, open_broadcasters: set[Broadcaster]
    ) -> None:
        """Use `TransformClient.broadcaster` instead."""
        super().__init__(connection, authority, open_broadcasters)
        self._connection = connection

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms at their stamps, without waiting for the server.

        The server drops transforms that are older than its cache time.

        Args:
            stampeds: One transform or several, each ``X_parent_child``: it maps coordinates in
                the child frame to coordinates in the parent frame. Metres; nanoseconds. Several
                are committed atomically, all or none of them.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send(StampedTransform("odom", "base", time.time_ns(), X_odom_base))``
        """
        self._dynamic_publisher.put(message(rows_of(stampeds)))

    def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold at all times, now and to every new server later.

        Like every put they may be lost with the connection; `TransformClient.set_transform`
        says whether a transform has arrived.

        Args:
            stampeds: One transform or several, each ``X_parent_child`` as in `send`. Their
                stamps do not matter. A newer transform of a child frame replaces the older one.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send_static(StampedTransform("base", "camera", 0, X_base_camera))``
        """
        self._put_static(rows_of(stampeds))

    def close(self) -> None:
        """Stop publishing. What was sent stays in the server. May be called again."""
        self._end()
