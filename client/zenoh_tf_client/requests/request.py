"""A request to the server, without any I/O: its message, and what its reply means.

`lookups`, `writes` and `info` have a function for each method of the client, which makes that
method's `Request`.

Client and transaction declare the methods once more, each with its own result type and docstring,
because editors and the API reference read both from the source; `batch_operations` lists them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from zenoh_tf import wire
from zenoh_tf.errors import InvalidArgumentException

T = TypeVar("T")

#: Longest wait of a lookup, in seconds. A longer one is probably in another unit.
MAX_WAIT_S = 3600.0


class Request(ABC, Generic[T]):
    """One operation of a client."""

    __slots__ = ()

    request_type: str  # one of zenoh_tf._net.keys.REQUEST_TYPES
    wait_s: float  # how long the server itself may wait
    writes: bool
    instance: str | None = None  # the server instance that must answer a write; None for any

    @property
    def group(self) -> str | None:
        """Concurrent requests of one group may share a message. None: it travels alone."""
        return None

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
    """Any operation except a `Read`."""

    request_type: str
    message: wire.Message
    parser: Callable[[wire.Message], T]
    wait_s: float = 0.0
    instance: str | None = None
    writes: bool = False

    def body(self) -> wire.Message:
        return self.message

    def parse(self, reply: wire.Message) -> T:
        return self.parser(reply)


def timeout_ns(timeout_s: float) -> int:
    """Return a time-out in nanoseconds; InvalidArgumentException if it is out of range."""
    if not 0 <= timeout_s <= MAX_WAIT_S:
        raise InvalidArgumentException(
            f"a time-out is from 0 to {MAX_WAIT_S:g} s, not {timeout_s!r}", field="timeout_s"
        )
    return int(timeout_s * 1e9)
