"""`TransformBroadcaster`: sends transforms, without waiting for those who receive them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, ClassVar

from zenoh_tf import StampedTransform

from . import sources, topics
from .messages import stamped_of

#: The authority if no node is given.
_DEFAULT_AUTHORITY = "tf2"


class TransformBroadcaster:
    """Sends TransformStampeds: to the server if the process has called `connect`, as the authority
    with the node's name, else on the topic /tf of the node, or of the process without a node.

    Thread safety: all methods.

    Args:
        node: A node of rclpy. Its name is used, with its namespace, and its topic.
        qos: The quality of service of the node's topic; None for tf2's.

    Raises:
        ServerUnavailable: The process has called `connect`, and no server answers.
    """

    _static: ClassVar[bool] = False
    #: Where it sends to; None: where `connect` leads.
    _server: ClassVar[sources.Server | None] = None

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        server = self._server or sources.connected()
        if server is None:
            self._send = topics.publisher(node, qos, static=self._static)
        else:
            self._send = server.publisher(authority_of(node), static=self._static)

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several, without waiting for who receives them.

        Who receives them logs what it rejects, and drops transforms older than its cache time; a
        server counts them, too.

        Args:
            transform: A message or an iterable of messages, which a server stores atomically.

        Raises:
            ServerUnavailable: The connection is closed.
            LimitExceeded: The message to the server would be larger than 16 MiB.
        """
        self._send(stampeds_of(transform))


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
