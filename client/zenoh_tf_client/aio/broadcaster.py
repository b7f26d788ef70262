"""`AsyncBroadcaster`: publishes transforms without waiting for a reply, and without blocking."""

from __future__ import annotations

from collections.abc import Iterable
from types import TracebackType
from typing import Self

from zenoh_tf import StampedTransform

from ..publish.broadcaster import Broadcaster
from .session.connection import Connection


class AsyncBroadcaster:
    """Publishes transforms as one authority; made by `AsyncTransformClient.broadcaster`.

    It has the methods of `Broadcaster` as coroutines. Messages are sent in the order of the calls,
    by a thread: a sensor that outruns the network waits, and the event loop goes on. An
    asynchronous context manager, which closes itself at the end.

    Concurrency: all methods, from any task of the client's event loop.
    """

    def __init__(self, connection: Connection, broadcaster: Broadcaster) -> None:
        """Use `AsyncTransformClient.broadcaster` instead.

        Args:
            connection: The connection that `broadcaster` publishes on.
            broadcaster: What publishes.
        """
        self._connection = connection
        self._broadcaster = broadcaster

    def __repr__(self) -> str:
        return repr(self._broadcaster).replace("<Broadcaster", "<AsyncBroadcaster", 1)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    @property
    def authority(self) -> str:
        """Returns the name that this broadcaster publishes as."""
        return self._broadcaster.authority

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
        await self._connection.run(lambda: self._broadcaster.send(stampeds))

    async def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold at all times, now and to every new server later.

        Like every put they may be lost with the connection; `AsyncTransformClient.set_transform`
        tells whether a transform has arrived.

        Args:
            stampeds: One transform or several, each ``X_parent_child`` as in `send`. Their
                stamps do not matter. A newer transform of a child frame replaces the older one.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``await wheels.send_static(StampedTransform("base", "camera", 0, X_base_camera))``
        """
        await self._connection.run(lambda: self._broadcaster.send_static(stampeds))

    async def close(self) -> None:
        """Stop publishing. What was sent stays in the server. May be called again."""
        if not self._connection.closed:  # the client closes its broadcasters
            await self._connection.run(self._broadcaster.close)
