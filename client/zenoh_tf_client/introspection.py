"""The methods of `TransformClient` that describe the tree."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/introspection.py: edit that.

from __future__ import annotations

from zenoh_tf import AuthorityInfo, ClientInfo, Explanation, FrameInfo
from zenoh_tf.introspection import explain as explaining
from zenoh_tf.shared_tree import AskServer

from .requests import info
from .session.connection import Connection
from .session.shared_reads import SharedReads


class Introspection:
    """A base of `TransformClient`, which has the connection."""

    _connection: Connection
    _reads: SharedReads

    def frames(self) -> list[str]:
        """List the names of all frames.

        A large tree is listed in several requests: a frame that is created or removed meanwhile
        may be listed or not.

        Returns:
            The names, in no particular order.

        Raises:
            ServiceException: As for every call; see the class.
        """
        found = self._reads.mapped.tree.frames()
        if type(found) is not AskServer:
            return found
        self._reads.mapped.request_update(found)
        names, after = self._connection.call(info.frames_page(None))
        while after is not None:
            page, after = self._connection.call(info.frames_page(after))
            names += page
        return names

    def frame(self, name: str) -> FrameInfo:
        """Describe a frame and the link to its parent.

        Args:
            name: The frame.

        Returns:
            The parent, authority, stamps in nanoseconds and counters, read at one instant.

        Raises:
            LookupException: The frame is unknown.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.
        """
        found = self._reads.mapped.tree.frame(name)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(found, info.frame(name))

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """Say why a lookup succeeds or fails: the chain link by link, and what limits it.

        Example: `print(tf.explain("map", "camera"))`

        Args:
            target: The lookup's target.
            source: The lookup's source.
            stamp_ns: The lookup's time in nanoseconds; None for the latest common time.

        Returns:
            The explanation, of the tree as of one instant.

        Raises:
            InvalidArgumentException: A name or the stamp is invalid.
            ServiceException: As for every call; see the class.
        """
        frames = self._ancestors(target, source, stamp_ns)
        names = [] if explaining.is_connected(target, source, frames) else self.frames()
        return explaining.explain(target, source, stamp_ns, frames, names)

    def _ancestors(self, target: str, source: str, stamp_ns: int | None) -> list[FrameInfo]:
        """The frames from both up to their roots, read at one instant."""
        found = self._reads.mapped.tree.ancestors(target, source, stamp_ns)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(found, info.ancestors(target, source, stamp_ns))

    def authorities(self) -> list[AuthorityInfo]:
        """List what each authority has published.

        Returns:
            One record for each authority, in the order of their first commits.

        Raises:
            ServiceException: As for every call; see the class.
        """
        return self._connection.call(info.authorities())

    def clients(self) -> list[ClientInfo]:
        """List the clients that are connected to the server, and how far their clocks are off.

        Returns:
            One record for each client whose clock is known, this one included.

        Raises:
            ServiceException: As for every call; see the class.
        """
        return self._connection.call(info.clients())

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """Return the parent of a frame.

        Args:
            frame: The frame.
            stamp_ns: The time in nanoseconds; None for the newest parent.

        Returns:
            The parent's name; None if the frame is a root.

        Raises:
            LookupException: The frame is unknown.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name, stamp or time-out is invalid.
            ServiceException: As for every call; see the class.
        """
        found = self._reads.mapped.tree.parent(frame, stamp_ns)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(found, info.parent(frame, stamp_ns))

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """Return the frames on the path between two frames.

        Args:
            target: The frame where the path begins.
            source: The frame where the path ends.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.

        Returns:
            The frames in order, from `target` to `source`, both included.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name, stamp or time-out is invalid.
            ServiceException: As for every call; see the class.
        """
        found = self._reads.mapped.tree.chain(target, source, stamp_ns)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(found, info.chain(target, source, stamp_ns))

    def stats(self) -> dict[str, int]:
        """Return the counters of the tree, of the server, and of how this client reads.

        Returns:
            Values by the counters' names. ``reads_shared`` is 1 if lookups read the server's memory
            now, ``reads_mapped`` counts how often it was mapped, ``reads_asked_*`` the lookups that
            asked the server instead, and ``reads_refused_*`` why its memory was not mapped.

        Raises:
            ServiceException: As for every call; see the class.
        """
        return self._connection.call(info.stats()) | self._reads.mapped.stats()
