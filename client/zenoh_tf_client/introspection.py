"""The methods of `TransformClient` that describe the tree."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/introspection.py: edit that.

from __future__ import annotations

from typing import TYPE_CHECKING

from zenoh_tf.errors import LookupException, ServerStarting
from zenoh_tf.shared_tree import AskServer

from .lookups import Lookups
from .requests import info
from .session.mapped_tree import MappedTree

if TYPE_CHECKING:
    from zenoh_tf import AuthorityInfo, ClientInfo, Explanation, FrameInfo


class Introspection(Lookups):
    """A base of `TransformClient`."""

    _mapped: MappedTree

    def frames(self) -> list[str]:
        """As `TransformTree.frames`, in no particular order.

        A large tree is listed in several requests: a frame that is created or removed meanwhile
        may be listed or not.
        """
        found = self._tree.frames()
        if not isinstance(found, AskServer):
            return found
        names, after = self._connection.call(info.frames_page(None), found)
        while after is not None:
            page, after = self._connection.call(info.frames_page(after))
            names += page
        return names

    def frame(self, name: str) -> FrameInfo:
        """As `TransformTree.frame`."""
        return self._look_up(self._tree.frame, info.frame, name)

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """As `TransformTree.parent`."""
        found = self._tree.parent(frame, stamp_ns)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(info.parent(frame, stamp_ns), found)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """As `TransformTree.chain`."""
        found = self._tree.chain(target, source, stamp_ns)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(info.chain(target, source, stamp_ns), found)

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `TransformTree.explain`."""
        from zenoh_tf.introspection import explain as explaining  # noqa: PLC0415 - slow

        ancestors = self._tree.ancestors
        frames = self._look_up(ancestors, info.ancestors, target, source, stamp_ns)
        names = [] if explaining.is_connected(target, source, frames) else self.frames()
        found = explaining.explain(target, source, stamp_ns, frames, names)
        for name in explaining.unknown_frames(found):
            try:
                self._connection.call(info.frame(name))
            except ServerStarting as error:
                found = explaining.starting(found, error)
            except LookupException:
                pass
        if explaining.is_of_mirror(found):
            found = explaining.with_lost_mirrors(found, self.authorities())
        parents, children = explaining.interpolated(found)
        if not parents:
            return found
        answers = self.lookup_transforms(parents, children, found.at_ns)
        return explaining.with_gaps(found, answers.gaps_ns.tolist())

    def authorities(self) -> list[AuthorityInfo]:
        """As `TransformTree.authorities`."""
        return self._connection.call(info.authorities())

    def clients(self) -> list[ClientInfo]:
        """List the clients that are connected to the server, and how far their clocks are off.

        Returns:
            One record for each client whose clock is known, this one included.

        Raises:
            ServiceException: As for every call; see the class.
        """
        return self._connection.call(info.clients())

    def stats(self) -> dict[str, int]:
        """As `TransformTree.stats`, with the counters of the server and of how this client reads.

        ``reads_shared`` is 1 if lookups read the server's memory now, ``reads_mapped`` counts how
        often it was mapped, ``reads_asked_*`` the lookups that asked the server instead, and
        ``reads_refused_*`` why its memory was not mapped.
        """
        return self._connection.call(info.stats()) | self._mapped.stats()
