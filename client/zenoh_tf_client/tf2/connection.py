"""The process's one connection, which every buffer and broadcaster of this package shares.

tf2's scripts name no server: theirs is whatever is on /tf. So there is one per process, and
the environment says which, unless `connect` does. Thread safety: all functions.
"""

from __future__ import annotations

import threading

from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable
from zenoh_tf.zenoh_config import address
from zenoh_tf_client import environment
from zenoh_tf_client.client import TransformClient

_lock = threading.Lock()
_client: TransformClient | None = None
_closer: threading.Thread | None = None
_ended = False


def connect(endpoint: str | None = None, tree: str | None = None) -> TransformClient:
    """The process's connection, opened if it is not: to `endpoint` and `tree`, else to what
    ZENOH_TF_CONNECT and ZENOH_TF_TREE say, else to the SDK's defaults.

    Buffers call it without arguments whenever they need the server, so a script only calls
    it to name another one, before anything else. Raises ServerUnavailable where no server
    answers (the next call tries again), InvalidArgumentException where the connection that
    is open leads elsewhere.
    """
    global _client, _closer  # noqa: PLW0603  # the one connection is what this module is about
    with _lock:
        if _ended:
            raise ServerUnavailable("the main thread has ended, and the connection with it")
        if _closer is None:
            _closer = threading.Thread(target=_close_at_the_end, name="tf2 closer")
            _closer.start()
        if _client is None:
            _client = TransformClient.connect(
                endpoint or environment.endpoint(),
                tree or environment.tree(),
            )
        elif (endpoint or _client.endpoint, tree or _client.tree) != (
            _client.endpoint,
            _client.tree,
        ):
            raise InvalidArgumentException(
                f"this process is connected to tree {_client.tree!r} at "
                f"{address(_client.endpoint)}; close() that connection first",
                field="endpoint",
            )
        return _client


def close() -> None:
    """Close the process's connection, and with it every broadcaster; the next use opens it
    anew. Called when the main thread ends."""
    global _client
    with _lock:
        client, _client = _client, None
    if client is not None:
        client.close()


def _close_at_the_end() -> None:
    """No script of tf2's closes anything. Exit handlers would be too late: they run when all
    threads have ended, and a static broadcaster's subscription keeps one of Zenoh's alive, as
    a lookup that waits does its own."""
    global _ended  # noqa: PLW0603
    threading.main_thread().join()
    with _lock:
        _ended = True
    close()
