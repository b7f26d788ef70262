"""The writes of `AsyncTransformClient`."""

from __future__ import annotations

from collections.abc import Sequence

from zenoh_tf import StampedTransform

from ..requests import writes
from .session.connection import AsyncConnection


class AsyncWrites:
    """A base of `AsyncTransformClient`, which has the connection."""

    _connection: AsyncConnection

    async def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> bool:
        """Store a transform and wait until the server has it.

        Args:
            stamped: ``X_parent_child``: it maps coordinates in the child frame to coordinates in
                the parent frame. Metres; nanoseconds.
            authority: The name to publish as.
            static: True for a transform that holds at all times.

        Returns:
            True if stored; False if dropped because it is older than the server's cache time.

        Raises:
            InvalidArgumentException: The transform is invalid, or would close a cycle.
            LimitExceeded: A limit is reached, such as the number of frames.
            ServiceException: As for every write; see the class.

        Example:
            ``tf.set_transform(StampedTransform("map", "base", time.time_ns(), X_map_base))``
        """
        return await self._connection.call(writes.set_transform(stamped, authority, static))

    async def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """As `TransformTree.set_transforms_xact`; waits until the server has them."""
        await self._connection.call(writes.set_transforms_xact(stampeds, authority, static))

    async def clear(self, keep_static: bool = True) -> None:
        """As `TransformTree.clear`, for all clients of the server."""
        await self._connection.call(writes.clear(keep_static))

    async def reset(self) -> None:
        """As `TransformTree.reset`, for all clients of the server.

        Broadcasters that keep static transforms do not announce them again until a server starts,
        and then all.
        """
        await self._connection.call(writes.reset())

    async def remove_frame(self, name: str, subtree: bool = False) -> None:
        """As `TransformTree.remove_frame`, for all clients of the server."""
        await self._connection.call(writes.remove_frame(name, subtree))
