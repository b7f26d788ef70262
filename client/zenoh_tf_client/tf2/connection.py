"""The process's one connection, which all buffers and broadcasters of this package share.

Scripts for tf2 name no server, because theirs is whatever is on /tf. So each process has one
connection. The environment names its server, unless the script calls `connect`.

Thread safety: all functions.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from zenoh_tf._net.zenoh_config import address, endpoints_of
from zenoh_tf.errors import InvalidArgumentException
from zenoh_tf_client.client import TransformClient

from .wait_loop import WaitLoop

_lock = threading.Lock()
_client: TransformClient | None = None
_waits: WaitLoop | None = None  # of `_client`, once a lookup waits


def connect(
    endpoint: str | Sequence[str] | None = None, tree: str | None = None
) -> TransformClient:
    """Return the process's connection; open it if there is none.

    Buffers and broadcasters call it without arguments. A script calls it only to name a server,
    before it makes anything else.

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
                _waits = _waits or WaitLoop(client)
                return _waits


def close() -> None:
    """Close the process's connection and all broadcasters. The next use opens a new connection.

    Waiting lookups fail, and message filters drop what they hold. A script need not call it:
    connections are closed when the interpreter ends.
    """
    global _client, _waits
    with _lock:
        client, _client = _client, None
        waits, _waits = _waits, None
    if waits is not None:
        waits.close()
    if client is not None:
        client.close()
