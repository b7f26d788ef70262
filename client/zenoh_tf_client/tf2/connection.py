"""The process's one connection, which all buffers and broadcasters on a server share."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from typing import Final

from zenoh_tf import FrameInfo, StampedTransform
from zenoh_tf._net.zenoh_config import address, endpoints_of
from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import InvalidArgumentException, LookupException
from zenoh_tf.tf2.wait_loop import WaitLoop
from zenoh_tf_client.aio.client import AsyncTransformClient
from zenoh_tf_client.aio.session.connection import AsyncConnection
from zenoh_tf_client.client import TransformClient


class Server:
    """Where the connection leads, which opens at the first use. Thread safety: all methods."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._client: TransformClient | None = None
        self._waits: WaitLoop | None = None  # of the client, once a lookup waits

    def connect(
        self, endpoint: str | Sequence[str] | None = None, tree: str | None = None
    ) -> TransformClient:
        """As `zenoh_tf.tf2.connect`."""
        with self._lock:
            client = self._client
            if client is None:
                client = self._client = TransformClient.connect(endpoint or None, tree or None)
            elif (
                endpoints_of(endpoint or client.connection.endpoints),
                tree or client.tree_name,
            ) != (client.connection.endpoints, client.tree_name):
                raise InvalidArgumentException(
                    f"this process is connected to tree {client.tree_name!r} at "
                    f"{address(client.endpoint)}; close() that connection first",
                    field="endpoint",
                )
            return client

    #: What buffers call, without arguments. Raises what `connect` raises, as all methods do.
    tree = connect

    def waits(self) -> WaitLoop:
        """Return the loop on which the process's lookups wait, on its connection."""
        raise_if_forked()
        while True:
            client = self.connect()
            with self._lock:
                if client is self._client:  # else another thread has closed it
                    self._waits = self._waits or _wait_loop(client)
                    return self._waits

    def frames(self) -> list[FrameInfo]:
        """Return what is known about every frame."""
        client, found = self.connect(), []
        with client.batch() as batch:
            handles = [batch.frame(name) for name in client.frames()]
        for handle in handles:
            with contextlib.suppress(LookupException):  # removed since its name was listed
                found.append(handle.result())
        return found

    def publisher(
        self, authority: str, *, static: bool
    ) -> Callable[[list[StampedTransform]], None]:
        """Return what publishes to the server."""
        broadcaster = self.connect().broadcaster(authority)
        return broadcaster.send_static if static else broadcaster.send

    def close(self) -> None:
        """As `zenoh_tf.tf2.close`."""
        with self._lock:
            client, self._client = self._client, None
            waits, self._waits = self._waits, None
        if waits is not None:
            waits.close()
        if client is not None:
            client.close()


def _wait_loop(client: TransformClient) -> WaitLoop:
    """A loop with the session of a client, which must stay open until the loop is closed."""
    connection, mapped = client._connection, client._mapped

    def lookups() -> contextlib.nullcontext[AsyncTransformClient]:
        return contextlib.nullcontext(AsyncTransformClient(AsyncConnection(connection, mapped)))

    return WaitLoop(lookups, lambda: connection.closed)


SERVER: Final = Server()
