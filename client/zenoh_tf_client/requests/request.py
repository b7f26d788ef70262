"""A request to the server, without any I/O: its message, and what its reply means.

`lookups`, `writes` and `info` have a function for each method of the client, which makes that
method's `Request`.

Client, batch and transaction declare the methods once more, each with its own result type and
docstring, because editors and the API reference read both from the source.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from zenoh_tf import Transform, wire
from zenoh_tf._core import pack_single_lookup, parse_single_answer
from zenoh_tf.errors import InvalidArgumentException, TransformException

from . import columns

T = TypeVar("T")

#: Longest wait of a lookup, in seconds. A longer one is probably in another unit.
MAX_WAIT_S = 3600.0


class Request(ABC, Generic[T]):
    """One operation of a client."""

    __slots__ = ()

    request_type: str  # one of zenoh_tf._net.keys.REQUEST_TYPES
    wait_s: float  # how long the server itself may wait

    @property
    def instance(self) -> str | None:
        """The server instance that must answer a write; None for any."""
        return None

    @property
    def group(self) -> str | None:
        """Concurrent requests of one group may share a message. None: it travels alone."""
        return None

    @property
    def writes(self) -> bool:
        return self.request_type in ("commit", "admin")

    @abstractmethod
    def body(self) -> wire.Message:
        """The message to send."""

    @abstractmethod
    def parse(self, reply: wire.Message) -> T:
        """Return the result in a reply, or raise its error."""

    def payload(self) -> bytes:
        """The bytes of the message."""
        return wire.pack(self.body())

    def parse_plain(self, reply: bytes, instance: str) -> tuple[T] | None:
        """The result in the bytes of a reply. None: they are not from this server instance, or
        need to be decoded for `parse`."""
        return None


@dataclass(slots=True)
class Call(Request[T]):
    """Any operation except a lookup."""

    request_type: str
    message: wire.Message
    parser: Callable[[wire.Message], T]
    wait_s: float = 0.0
    instance: str | None = None
    group: str | None = None

    def body(self) -> wire.Message:
        return self.message

    def parse(self, reply: wire.Message) -> T:
        return self.parser(reply)


def _raise(error: TransformException) -> Any:
    raise error


#: Makes a result from a row of a reply: (request's row, stamp, newest stamp, pose) -> result, and
#: the gap behind the pose, if there is one.
Convert = Callable[..., T]


@dataclass(slots=True)
class Read(Request[T]):
    """A lookup of a single row; a batch sends neighbouring ones as one operation."""

    row: columns.Row
    convert: Convert[T]
    wait_s: float = 0.0
    failed: Callable[[TransformException], T] = _raise
    request_type: str = "lookup"
    writes: ClassVar[bool] = False

    @property
    def group(self) -> str | None:
        # The reply to a message comes when the last of its lookups has been waited for.
        return None if self.wait_s else self.request_type

    def body(self) -> wire.Message:
        body = wire.one_read(*self.row)
        if self.wait_s:
            body["timeout_ns"] = timeout_ns(self.wait_s)
        return body

    def parse(self, reply: wire.Message) -> T:
        one = wire.parse_one_answer(reply)
        if one is not None:
            stamp_ns, newest_ns, pose = one
            return self.convert(self.row, stamp_ns, newest_ns, Transform.from_pose(pose))
        return self.answer(wire.parse_lookup_reply(reply, 1))

    def payload(self) -> bytes:
        if self.wait_s:
            return wire.pack(self.body())
        return pack_single_lookup(*self.row) or wire.pack(self.body())

    def parse_plain(self, reply: bytes, instance: str) -> tuple[T] | None:
        answer = parse_single_answer(reply, instance)
        return None if answer is None else (self.convert(self.row, *answer),)

    def lookup(self) -> wire.Lookup:
        """Return the row as columns."""
        return columns.join([self.row])

    def answer(self, reply: wire.LookupReply) -> T:
        """Return the result in a reply of one row, or raise its error."""
        return self.result(next(reply.rows()))

    def result(self, answer: wire.AnswerRow) -> T:
        """Return the result in one row of a reply, or raise its error."""
        error, stamp_ns, newest_ns, pose, gap_ns = answer
        if error:
            return self.failed(error)
        return self.convert(self.row, stamp_ns, newest_ns, Transform.from_pose(pose), gap_ns)


@dataclass(slots=True)
class Rows(Request[T]):
    """A lookup of any number of rows."""

    rows: wire.Lookup
    convert: Callable[[wire.LookupReply], T]
    wait_s: float = 0.0
    request_type: str = "lookup"

    def body(self) -> wire.Message:
        return wire.lookup_body(self.rows)

    def parse(self, reply: wire.Message) -> T:
        return self.convert(wire.parse_lookup_reply(reply, self.rows.rows))

    def lookup(self) -> wire.Lookup:
        """Return the columns."""
        return self.rows

    def answer(self, reply: wire.LookupReply) -> T:
        """Return the result in a reply, or raise its error."""
        return self.convert(reply)


#: A lookup of either form.
Lookup = Read[T] | Rows[T]

#: What a lookup of a transaction gives: the server instance, the read set, and a function that
#: returns the result or raises the lookup's error.
VersionedRead = tuple[str, Iterable[tuple[str, int]], Callable[[], T]]


def timeout_ns(timeout_s: float) -> int:
    """Return a time-out in nanoseconds; InvalidArgumentException if it is out of range."""
    if not 0 <= timeout_s <= MAX_WAIT_S:
        raise InvalidArgumentException(
            f"timeout_s must be from 0 to {MAX_WAIT_S:g}, not {timeout_s!r}", field="timeout_s"
        )
    return int(timeout_s * 1e9)
