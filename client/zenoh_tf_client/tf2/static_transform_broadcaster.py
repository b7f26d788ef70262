"""`StaticTransformBroadcaster`: transforms that hold at all times."""

from __future__ import annotations

from typing import Any

from .connection import connect
from .transform_broadcaster import authority_of, stampeds_of


class StaticTransformBroadcaster:
    """As `TransformBroadcaster`, for static transforms.

    It keeps the last transform of each child frame and announces them all to every new server.
    Thread safety: all methods.

    Args:
        node: Named as the authority; see `TransformBroadcaster`.
        qos: Has no effect.

    Raises:
        ServerUnavailable: No server answers.
    """

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self._broadcaster = connect().broadcaster(authority_of(node))

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several, without waiting for the server.

        Args:
            transform: A message or an iterable of messages, which are stored atomically.

        Raises:
            ServerUnavailable: The connection is closed.
            LimitExceeded: The message would be larger than 16 MiB.
        """
        self._broadcaster.send_static(stampeds_of(transform))
