"""Lookups in the server's memory, and by query where that has no answer."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/session/shared_reads.py: edit that.

from __future__ import annotations

from typing import Any, TypeVar

from zenoh_tf.shared_tree import AskServer

from ..requests import lookups
from ..requests.request import Read, Request, Rows, VersionedRead
from ..session.mapped_tree import MappedTree, read_tree
from .connection import Connection

T = TypeVar("T")


class SharedReads:
    """The lookups of one client. What is in memory is read without waiting.

    Concurrency: all methods.
    """

    def __init__(self, connection: Connection, mapped: MappedTree) -> None:
        self._connection = connection
        self.mapped = mapped

    def ask(self, why: Any, request: Request[T]) -> T:
        """Ask the server. The caller has read the tree in memory before, which has returned
        `why`, an AskServer."""
        mapped = self.mapped
        mapped.asked[why] += 1
        try:
            return self._connection.call(request)
        finally:
            mapped.request_update(why)

    def read_versions(self, request: Read[T] | Rows[T]) -> VersionedRead[T]:
        """Look up as a part of a transaction."""
        tree = self.mapped.tree
        found = read_tree(tree, tree.instance, request)
        if not isinstance(found, AskServer):
            return found
        return self.ask(found, lookups.with_versions(request))
