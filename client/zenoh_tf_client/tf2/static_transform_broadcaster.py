"""`StaticTransformBroadcaster`: transforms that hold at all times."""

from __future__ import annotations

from typing import Any

from .transform_broadcaster import TransformBroadcaster, stampeds_of


class StaticTransformBroadcaster(TransformBroadcaster):
    """As `TransformBroadcaster`, for static transforms.

    It keeps the last transform of each child frame and announces them all to every new server.
    """

    def sendTransform(self, transform: Any) -> None:
        """As `TransformBroadcaster.sendTransform`, and at every new server again."""
        self._broadcaster.send_static(stampeds_of(transform))
