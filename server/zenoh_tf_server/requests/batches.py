"""Batches: operations that run one after another, and share one reply and one budget.

The replies are packed as they are made, so that a batch costs little more than its own reply.
Thread safety: a batch belongs to one thread at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException, LimitExceeded, NotDurable

from ..state.static_links import NO_STATE_WRITE
from .handler import typed_error

if TYPE_CHECKING:
    from zenoh_tf._core import Rows

    from .service import Service

#: The reply to an operation whose own has no room. Each operation has room for that.
NO_ROOM: Final = wire.pack(
    {
        "error": wire.encode_error(
            LimitExceeded("the reply is full (--limit reply_bytes=N)", field="reply_bytes")
        )
    }
)
#: An error of an operation is shortened beyond the limit on bytes of errors.
_SHORT: Final = "no room for details"
#: Most operations of a batch.
_MAX_OPERATIONS: Final = 25_000
#: After so many rows, other threads may run.
_SLICE_ROWS: Final = 1000
#: Long enough for a thread that waits for the interpreter to get it, which a yield alone is not.
_PAUSE_S: Final = 20e-6


class BatchRun:
    """One message's operations on a service."""

    def __init__(self, service: Service, body: wire.Message) -> None:
        """Parse the message.

        Raises:
            ProtocolError: It is malformed.
            LimitExceeded: It has too many operations, or not even their errors fit in a reply.
        """
        self._list = wire.parse_batch(body)
        if len(self._list) > _MAX_OPERATIONS:
            raise LimitExceeded(
                f"a batch of {len(self._list)} operations: the limit is {_MAX_OPERATIONS}",
                field="operations",
                limit=_MAX_OPERATIONS,
                value=len(self._list),
            )
        self._service = service
        self._limits = limits = service.limits
        #: What is left for this message.
        self.budget = limits.budget()
        self._error_bytes = limits.error_bytes
        self._rows = 0
        self._replies: list[bytes] = []
        #: Lookups that wait, by the index of their operation. They run when the others have.
        self.waiting: dict[int, wire.Lookup] = {}
        #: How many of the operations write.
        self.commits = sum(request_type == "commit" for request_type, _ in self._list)
        self.budget.take_reply(len(self._list) * len(NO_ROOM))

    @property
    def most_outcome_bytes(self) -> int:
        """An upper bound of the length of `outcome`."""
        errors = min(self._error_bytes, self.commits * self._limits.name_bytes * 8)
        return self.commits * len(NO_ROOM) + errors

    def run(self, expires_ns: int | None) -> None:
        """Run all operations; commits only before `expires_ns`."""
        state_writes: dict[int, int] = {}

        def commit(body: wire.Message) -> wire.Message:
            reply, state_write = self._service.run_commit(self._commit(body), expires_ns)
            if state_write != NO_STATE_WRITE:
                state_writes[len(self._replies)] = state_write
            return reply

        self._run(commit)
        try:
            self._service.links.wait(max(state_writes.values(), default=NO_STATE_WRITE))
        except NotDurable as error:
            for index in state_writes:
                self._replies[index] = self._fit(self._failure(error))

    def run_reads(self, outcome: bytes) -> None:
        """Run all operations but the commits, whose replies are those in `outcome`."""
        remembered = iter(wire.unpack(outcome, wire.MAX_REPLY_BYTES)["replies"])
        self._run(lambda _: next(remembered))

    def outcome(self) -> bytes:
        """The replies to the commits, for `run_reads` of a repeat."""
        pairs = zip(self._list, self._replies, strict=True)
        return self._packed(
            [reply for (request_type, _), reply in pairs if request_type == "commit"]
        )

    def reply(self) -> bytes:
        """The reply's bytes."""
        return self._packed(self._replies)

    def settle(self, found: list[Rows]) -> bytes:
        """The reply's bytes, with the results of the waiting lookups."""
        for (index, lookup), rows in zip(self.waiting.items(), found, strict=True):
            self._replies[index] = self._fit(wire.lookup_reply(lookup, *rows))
        return self.reply()

    def _packed(self, replies: list[bytes]) -> bytes:
        return wire.batch_reply(replies, self._service.instance)

    def _run(self, commit: Callable[[wire.Message], wire.Message]) -> None:
        next_pause = _SLICE_ROWS
        for request_type, body in self._list:
            try:
                if request_type == "lookup":
                    reply = self._lookup(body)
                elif request_type == "commit":
                    reply = commit(body)
                else:
                    reply = self._service.info(body, self.budget)
            except Exception as error:
                reply = self._failure(error)
            self._replies.append(self._fit(reply))
            done = self._rows + len(self._replies)
            if done >= next_pause:
                next_pause = done + _SLICE_ROWS
                time.sleep(_PAUSE_S)

    def _lookup(self, body: wire.Message) -> wire.Message:
        one = wire.parse_one_read(body)
        if one is not None and (found := self._service.reads.one(*one, self.budget)):
            self._count(1)
            return found
        lookup = wire.parse_lookup(body)
        self._count(lookup.rows)
        if not lookup.timeout_ns:
            return self._service.reads.rows(lookup, self.budget)
        if self.commits:
            raise InvalidArgumentException(
                "a lookup in a batch that writes cannot wait: leave out timeout_s, or "
                "send it in a batch of its own",
                field="timeout_ns",
            )
        self.waiting[len(self._replies)] = lookup
        return {}

    def _commit(self, body: wire.Message) -> wire.Commit:
        commit = wire.parse_commit(body)
        self._count(len(commit.rows))
        return commit

    def _count(self, rows: int) -> None:
        self._rows += rows
        self._limits.check("rows", self._rows)

    def _fit(self, reply: wire.Message) -> bytes:
        """The reply's bytes, or those of an error if they have no room."""
        data = wire.pack_in_steps(reply)
        extra = len(data) - len(NO_ROOM)
        if extra > 0:
            try:
                self.budget.take_reply(extra)
            except LimitExceeded:
                return NO_ROOM
        return data

    def _failure(self, error: Exception) -> wire.Message:
        fields = wire.encode_error(typed_error(error))
        self._error_bytes -= 2 * len(fields["message"])
        if self._error_bytes < 0:
            fields["message"], fields["facts"] = _SHORT, {}
        return {"error": fields}
