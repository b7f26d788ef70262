"""`TransformBroadcaster`: sends transforms to the server, without waiting for it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from zenoh_tf import StampedTransform

from .connection import connect
from .messages import stamped_of

#: The authority if no node is given.
_DEFAULT_AUTHORITY = "tf2"


class TransformBroadcaster:
    """Sends TransformStampeds as the authority with the node's name.

    Thread safety: all methods.

    Args:
        node: Only its name is used, with its namespace.
        qos: Has no effect.

    Raises:
        ServerUnavailable: No server answers.
    """

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self._broadcaster = connect().broadcaster(authority_of(node))

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several, without waiting for the server.

        The server logs and counts what it rejects, and drops transforms older than its cache time.

        Args:
            transform: A message or an iterable of messages, which are stored atomically.

        Raises:
            ServerUnavailable: The connection is closed.
            LimitExceeded: The message would be larger than 16 MiB.
        """
        self._broadcaster.send(stampeds_of(transform))


def authority_of(node: Any) -> str:
    """Return a node's name with its namespace."""
    for name in ("get_fully_qualified_name", "get_name"):
        if hasattr(node, name):
            return str(getattr(node, name)())
    return _DEFAULT_AUTHORITY


def stampeds_of(transform: Any) -> list[StampedTransform]:
    """Convert one message or several to the SDK's class."""
    messages = transform if isinstance(transform, Iterable) else [transform]
    return [stamped_of(message) for message in messages]
