"""Reads the server's tree in memory for an asynchronous client; see `...session.shared_reads`.

What is in memory is read without suspending the caller.
"""

from __future__ import annotations

from typing import Any, TypeVar

from zenoh_tf.shared_tree import AskServer, SharedTree

from ...requests import lookups
from ...requests.request import Read, Request, Rows, VersionedRead
from ...session.shared_reads import Mode
from .connection import Connection

T = TypeVar("T")


class SharedReads:
    """The mapped tree of the server that a connection has. Thread safety: the loop's thread."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._mapped = connection.mapped

    @property
    def tree(self) -> SharedTree:
        """The mapped tree, or what stands for it."""
        return self._mapped.tree

    @property
    def in_use(self) -> Mode:
        """How a lookup would be answered now."""
        return self._mapped.in_use

    async def ask(self, why: Any, request: Request[T]) -> T:
        """Ask the server, because the tree in memory has returned an AskServer."""
        self._mapped.count(why)
        try:
            return await self._connection.call(request)
        finally:
            self._mapped.note(why)

    async def read_versions(self, request: Read[T] | Rows[T]) -> VersionedRead[T]:
        """Look up as a part of a transaction."""
        found = self._mapped.read_mapped_versions(request)
        if not isinstance(found, AskServer):
            return found
        return await self.ask(found, lookups.with_versions(request))

    def note(self, why: AskServer) -> None:
        """Let a thread look for the tree of a new server, if there is one."""
        self._mapped.note(why)

    def stats(self) -> dict[str, int]:
        """The counters of this client: how it reads, how often not so, and why."""
        return self._mapped.stats()
