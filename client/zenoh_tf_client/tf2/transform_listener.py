"""`TransformListener`: nothing to listen to, so that a script's line may stay."""

from __future__ import annotations

from typing import Any

from .buffer import Buffer


class TransformListener:
    """Keeps `buffer` and `node`, and does nothing: the server listens for everyone.

    Nothing has to spin either, so a lookup may wait in a callback. `spin_thread`, `qos` and
    `static_qos` are without effect. Other topics than /tf are other trees (ZENOH_TF_TREE),
    so there is no argument for them.
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
        """Nothing to undo."""
