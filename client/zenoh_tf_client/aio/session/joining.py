"""Joins concurrent requests into one message, without any I/O.

The operations of a message have one reply. Each is a transaction of its own, as if it had been
sent alone.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from zenoh_tf import wire
from zenoh_tf.errors import ProtocolError, ServiceException

from ...requests import columns
from ...requests.lookups import Read
from ...requests.request import Request

#: Returns the result of one operation, or raises its error.
Result = Callable[[], Any]


class Joined(Request[list[Result]]):
    """One message for several operations. Its result has one for each, in order."""

    wait_s = 0.0
    writes = False

    @abstractmethod
    def is_refused(self, error: Exception) -> bool:
        """Whether the message was refused before any operation ran, maybe because of one of
        them, so that the others may be sent again."""


class JoinedReads(Joined):
    """Lookups of single rows, as one lookup of many."""

    request_type = "lookup"

    def __init__(self, reads: Sequence[Read[Any]]) -> None:
        self._reads = reads

    def body(self) -> wire.Message:
        return wire.lookup_body(columns.join([read.row for read in self._reads]))

    def parse(self, reply: wire.Message) -> list[Result]:
        rows = wire.parse_lookup_reply(reply, len(self._reads)).rows()
        return [partial(read.result, row) for read, row in zip(self._reads, rows, strict=True)]

    def is_refused(self, error: Exception) -> bool:
        # To read again does no harm.
        return isinstance(error, ProtocolError) or not isinstance(error, ServiceException)


class JoinedWrites(Joined):
    """Commits of one authority, as a batch."""

    request_type = "batch"
    writes = True

    def __init__(self, commits: Sequence[Request[Any]]) -> None:
        self._commits = commits

    def body(self) -> wire.Message:
        return wire.batch_body([(commit.request_type, commit.body()) for commit in self._commits])

    def parse(self, reply: wire.Message) -> list[Result]:
        replies = wire.parse_batch_reply(reply, len(self._commits))
        return [
            partial(commit.parse, one) for commit, one in zip(self._commits, replies, strict=True)
        ]

    def is_refused(self, error: Exception) -> bool:
        return not isinstance(error, ServiceException)


def join(requests: Sequence[Request[Any]]) -> Joined:
    """Return one request for several of a group."""
    if requests[0].writes:
        return JoinedWrites(requests)
    return JoinedReads([request for request in requests if isinstance(request, Read)])
