"""`MirrorTransaction`: a transaction whose reads are in a mirror."""

from __future__ import annotations

from typing import TypeVar

from zenoh_tf import TransformTree, wire

from .connection import Connection
from .request import Request
from .transaction import Transaction

T = TypeVar("T")


class MirrorTransaction(Transaction):
    """One attempt, which reads one copy of the tree. Thread safety: one thread at a time.

    A mirror's frames have the server's versions, so its reads can be the read set of a commit.
    """

    def __init__(self, connection: Connection, tree: TransformTree, instance: str) -> None:
        super().__init__(connection)
        self._tree = tree
        self._instance = instance

    def _is_done(self) -> bool:
        # Unlike at the server, a single read may be old.
        return not self._sets and not self._reads

    def _reply(self, request: Request[T]) -> wire.Message:
        lookup = wire.parse_lookup(_as_received(request.body()))
        rows = self._tree._read_rows(
            lookup.names,
            lookup.op,
            lookup.target,
            lookup.source,
            lookup.stamp,
            lookup.fixed,
            lookup.source_stamp,
            atomic=lookup.atomic,
            versions=True,
            errors=lookup.errors,
        )
        reply = {"v": wire.VERSION, "instance": self._instance}
        return _as_received(reply | wire.lookup_reply(lookup, *rows))


def _as_received(message: wire.Message) -> wire.Message:
    """The message as the other side would parse it."""
    return wire.unpack(wire.pack(message))
