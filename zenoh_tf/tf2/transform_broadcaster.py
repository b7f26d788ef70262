"""`TransformBroadcaster`: sends transforms, without waiting for those who receive them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from . import sources, topics
from .messages import stamped_of

if TYPE_CHECKING:
    from zenoh_tf_client.tf2.connection import Server

#: The authority if no node is given.
_DEFAULT_AUTHORITY = "tf2"


class TransformBroadcaster:
    """Sends TransformStampeds on /tf, the node's topic, or the process's without a node; to the
    server if the process has called `connect`, as the authority with the node's name.

    Thread safety: all methods.

    Args:
        node: A node of rclpy. Without one, or with an object that has only a name (`get_name`), the
            topics are the process's.
        qos: The quality of service of the node's topic; None for tf2's.

    Raises:
        InvalidArgumentException: `node` has neither topics nor a name.
        ServerUnavailable: The process has called `connect`, and no server answers.
    """

    _static: ClassVar[bool] = False
    #: Where it sends to; None: where `connect` leads.
    _server: ClassVar[Server | None] = None

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        server = self._server or sources.connected()
        topics.check_node(node)
        if server is None:
            self._send = topics.publisher(node, qos, static=self._static)
        else:
            self._send = server.publisher(authority_of(node), static=self._static)

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several, without waiting.

        Who receives them logs what it rejects, and drops transforms older than its cache time.

        Args:
            transform: A message or an iterable of messages, which a server stores atomically.

        Raises:
            ServerUnavailable: The connection is closed.
            LimitExceeded: The message to the server would be larger than 16 MiB.
        """
        messages = transform if isinstance(transform, Iterable) else [transform]
        self._send([stamped_of(message) for message in messages])


def authority_of(node: Any) -> str:
    """Return a node's name with its namespace."""
    for name in ("get_fully_qualified_name", "get_name"):
        if hasattr(node, name):
            return str(getattr(node, name)())
    return _DEFAULT_AUTHORITY
