"""The writes of `TransformClient`."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/writes.py: edit that.

from __future__ import annotations

from collections.abc import Sequence

from zenoh_tf import StampedTransform

from .requests import writes
from .session.connection import Connection


class Writes:
    """A base of `TransformClient`, which has the connection."""

    _connection: Connection

    def set_transform(
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
        return self._connection.call(writes.set_transform(stamped, authority, static))

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> None:
        """Store transforms atomically, all or none of them, and wait until the server has them.

        Args:
            stampeds: Transforms, each ``X_parent_child`` as in `set_transform`.
            authority: The name to publish as.
            static: True for transforms that hold at all times.

        Raises:
            InvalidArgumentException: A transform is invalid, is older than the server's cache
                time, or would close a cycle.
            LimitExceeded: A limit is reached, such as the number of frames.
            ServiceException: As for every write; see the class.
        """
        self._connection.call(writes.set_transforms_xact(stampeds, authority, static))

    def clear(self, keep_static: bool = True) -> None:
        """Forget all samples, for all clients of the server. The frames' names stay.

        Args:
            keep_static: True to keep static transforms.

        Raises:
            LimitExceeded: A limit is reached, such as the number of frames.
            ServiceException: As for every write; see the class.
        """
        self._connection.call(writes.clear(keep_static))

    def reset(self) -> None:
        """Drop every frame at one instant: all samples, static links and names.

        The tree is then as new, apart from its counters and authorities. Broadcasters that
        keep static transforms do not announce them again until a server starts, and then all.

        Raises:
            ServiceException: As for every write; see the class.

        Example:
            >>> tf.reset()
            >>> tf.frames()
            []
        """
        self._connection.call(writes.reset())

    def remove_frame(self, name: str, subtree: bool = False) -> None:
        """Forget a frame: its link, its history and its name.

        Args:
            name: The frame.
            subtree: True to remove all frames below it as well, atomically.

        Raises:
            LookupException: The frame is unknown.
            InvalidArgumentException: Other frames are below it, and `subtree` is False.
            LimitExceeded: A limit is reached, such as the number of frames.
            ServiceException: As for every write; see the class.
        """
        self._connection.call(writes.remove_frame(name, subtree))
