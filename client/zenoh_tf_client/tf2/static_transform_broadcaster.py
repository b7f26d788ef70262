"""`StaticTransformBroadcaster`: transforms that hold for all times."""

from __future__ import annotations

from typing import Any

from .connection import connect
from .transform_broadcaster import authority_of, stampeds_of


class StaticTransformBroadcaster:
    """As `TransformBroadcaster`, for static links. Keeps the last one of every child that it
    was ever given, and sends them all to every server to come."""

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self._broadcaster = connect().broadcaster(authority_of(node))

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several, at one instant."""
        self._broadcaster.send_static(stampeds_of(transform))
