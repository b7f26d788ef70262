"""`TransformBroadcaster`: transforms to the server, without waiting for it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from zenoh_tf import StampedTransform

from .connection import connect
from .messages import stamped_of

#: Who publishes where no node says its name.
_NAMELESS = "tf2"


class TransformBroadcaster:
    """Sends TransformStampeds as the authority that `node` is named; nothing else is asked of
    the node. `qos` is without effect. Raises ServerUnavailable where no server answers.

    Thread safety: all methods.
    """

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self._broadcaster = connect().broadcaster(authority_of(node))

    def sendTransform(self, transform: Any) -> None:
        """Send one TransformStamped or several. Several are stored at one instant, or not at
        all if one of them makes no sense: the server logs which. Those too old are dropped."""
        self._broadcaster.send(stampeds_of(transform))


def authority_of(node: Any) -> str:
    """A node's name with its namespace."""
    for name in ("get_fully_qualified_name", "get_name"):
        if hasattr(node, name):
            return str(getattr(node, name)())
    return _NAMELESS


def stampeds_of(transform: Any) -> list[StampedTransform]:
    messages = transform if isinstance(transform, Iterable) else [transform]
    return [stamped_of(message) for message in messages]
