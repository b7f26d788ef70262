"""`BufferClient`: a `Buffer` with the constructor of tf2_ros's client of a buffer server."""

from __future__ import annotations

from typing import Any

from . import sources
from .buffer import Buffer


class BufferClient(Buffer):
    """A `Buffer` on the server's tree, also without `connect`. It needs no buffer server in the ROS
    graph, so it waits for none before the first lookup, and ends each lookup at its time-out.

    Args:
        node: Kept as the attribute `node`.
        ns: Has no effect: ZENOH_TF_CONNECT names the server.
        check_frequency: Kept as an attribute; has no effect, because nothing polls.
        timeout_padding: Kept as an attribute; has no effect.
    """

    def __init__(
        self,
        node: Any = None,
        ns: str = "",
        check_frequency: float | None = 10.0,
        timeout_padding: Any = None,
    ) -> None:
        super().__init__(source=sources.server())
        self.node = node
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding
