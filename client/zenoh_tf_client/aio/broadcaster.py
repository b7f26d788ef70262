"""`AsyncBroadcaster`: publishes transforms without waiting for a reply, as sensors need it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from zenoh_tf import StampedTransform

from ..publish.publisher import message
from ..publish.publishing import Publishing, rows_of
from .session.connection import Connection


class AsyncBroadcaster(Publishing):
    """Publishes transforms as one authority; made by `AsyncTransformClient.broadcaster`.

    One call sends one message, which the server commits atomically. The server sends no reply: it
    logs and counts what it rejects. The broadcaster keeps its static transforms and announces
    them to every new server, which leaves out those that a call or another authority has changed
    or removed since. Messages are sent in the order of the calls, by a thread: a sensor that
    outruns the network waits, not the event loop. An asynchronous context manager, which
    closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop.
    """

    def __init__(
        self, connection: Connection, authority: str, open_broadcasters: set[AsyncBroadcaster]
    ) -> None:
        """Use `AsyncTransformClient.broadcaster` instead."""
        super().__init__(connection.opened, authority, open_broadcasters)
        self._connection = connection

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def send(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
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
            ``await wheels.send(StampedTransform("odom", "base", time.time_ns(), X_odom_base))``
        """
        await self._connection.run(lambda: self._dynamic_publisher.put(message(rows_of(stampeds))))

    async def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold at all times, now and to every new server later.

        Like every put they may be lost with the connection; `AsyncTransformClient.set_transform`
        says whether a transform has arrived.

        Args:
            stampeds: One transform or several, each ``X_parent_child`` as in `send`. Their
                stamps do not matter. A newer transform of a child frame replaces the older one.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``await wheels.send_static(StampedTransform("base", "camera", 0, X_base_camera))``
        """
        await self._connection.run(lambda: self._put_static(rows_of(stampeds)))

    async def close(self) -> None:
        """Stop publishing. What was sent stays in the server. May be called again."""
        if True:  # asynchronous
            if not self._connection.closed:  # the client closes its broadcasters
                await self._connection.run(self._end)
        else:
            self._end()
