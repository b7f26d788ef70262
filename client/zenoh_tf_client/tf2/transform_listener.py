"""`TransformListener`: does nothing, so that a script need not change."""

from __future__ import annotations

from typing import Any

from .buffer import Buffer


class TransformListener:
    """Does nothing, because the server receives the transforms of all publishers.

    No thread has to spin, so a lookup may wait in a callback. There is no argument for other
    topics than /tf: they are other trees (ZENOH_TF_TREE).

    Args:
        buffer: Kept as the attribute `buffer`.
        node: Kept as the attribute `node`.
        spin_thread: Has no effect.
        qos: Has no effect.
        static_qos: Has no effect.
    """

    def __init__(
        self,
        buffer: Buffer,
        node: Any = None,
        *,
        spin_thread: bool = False,
        qos: Any = None,
        static_qos: Any = None,
    ) -> None:
        self.buffer = buffer
        self.node = node

    def unregister(self) -> None:
        """Do nothing."""
