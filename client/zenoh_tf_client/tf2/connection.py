"""The process's one connection, which all buffers and broadcasters on a server share.

Thread safety: all functions.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from typing import Final

from zenoh_tf import FrameInfo, StampedTransform
from zenoh_tf._net.zenoh_config import address, endpoints_of
from zenoh_tf._zenoh.calls import raise_if_forked
from zenoh_tf.errors import InvalidArgumentException, LookupException
from zenoh_tf.tf2 import sources
from zenoh_tf.tf2.wait_loop import WaitLoop
from zenoh_tf_client.aio.client import AsyncTransformClient
from zenoh_tf_client.aio.session.connection import AsyncConnection
from zenoh_tf_client.client import TransformClient

_lock = threading.Lock()
_client: TransformClient | None = None
_waits: WaitLoop | None = None  # of `_client`, once a lookup waits


def connect(
    endpoint: str | Sequence[str] | None = None, tree: str | None = None
) -> TransformClient:
    """As `zenoh_tf.tf2.connect`, for those buffers and broadcasters that need it."""
    global _client  # noqa: PLW0603
    with _lock:
        if _client is None:
            _client = TransformClient.connect(endpoint or None, tree or None)
        elif (
            endpoints_of(endpoint or _client.connection.endpoints),
            tree or _client.tree_name,
        ) != (_client.connection.endpoints, _client.tree_name):
            raise InvalidArgumentException(
                f"this process is connected to tree {_client.tree_name!r} at "
                f"{address(_client.endpoint)}; close() that connection first",
                field="endpoint",
            )
        return _client


def wait_loop() -> WaitLoop:
    """Return the loop on which the process's lookups wait, on its connection.

    Raises what `connect` raises.
    """
    global _waits  # noqa: PLW0603
    while True:
        client = connect()
        with _lock:
            if client is _client:  # else another thread has closed it
                _waits = _waits or _wait_loop(client)
                return _waits


def _wait_loop(client: TransformClient) -> WaitLoop:
    """A loop with the session of a client, which must stay open until the loop is closed."""
    connection = client._connection

    def lookups() -> contextlib.nullcontext[AsyncTransformClient]:
        session = AsyncConnection(connection, client._mapped)
        return contextlib.nullcontext(AsyncTransformClient(session))

    return WaitLoop(lookups, lambda: connection.closed, raise_if_forked)


def close() -> None:
    """As `zenoh_tf.tf2.close`."""
    global _client, _waits
    with _lock:
        client, _client = _client, None
        waits, _waits = _waits, None
    if waits is not None:
        waits.close()
    if client is not None:
        client.close()


class _Server:
    """The server of the process's connection, which opens at the first use."""

    def tree(self) -> TransformClient:
        return connect()

    def waits(self) -> WaitLoop:
        return wait_loop()

    def frames(self) -> list[FrameInfo]:
        client = connect()
        with client.batch() as batch:
            handles = [batch.frame(name) for name in client.frames()]
        found = []
        for handle in handles:
            with contextlib.suppress(LookupException):  # removed since its name was listed
                found.append(handle.result())
        return found

    def publisher(
        self, authority: str, *, static: bool
    ) -> Callable[[list[StampedTransform]], None]:
        broadcaster = connect().broadcaster(authority)
        return broadcaster.send_static if static else broadcaster.send


SERVER: Final[sources.Server] = _Server()
