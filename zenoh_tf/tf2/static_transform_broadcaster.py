"""`StaticTransformBroadcaster`: transforms that hold at all times."""

from __future__ import annotations

from .transform_broadcaster import TransformBroadcaster


class StaticTransformBroadcaster(TransformBroadcaster):
    """As `TransformBroadcaster`, for static transforms and /tf_static.

    It keeps the last transform of each child frame, and sends them all to every new server; late
    listeners get them as well.
    """

    _static = True
