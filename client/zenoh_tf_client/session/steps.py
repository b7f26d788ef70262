"""The steps of an exchange: what to do next, for a connection that runs them."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, TypeVar

import zenoh

from zenoh_tf import wire
from zenoh_tf._net.queries import NoReply

from ..requests.receipt import Receipt

T = TypeVar("T")


@dataclass(slots=True)  # a frozen one takes three times as long to make
class Ask:
    """A step: send a query. Its outcome is the reply's bytes, or a `NoReply`."""

    key: zenoh.KeyExpr
    payload: bytes
    timeout_s: float


@dataclass(slots=True)
class JudgedQuery(Ask):
    """A query to the server, with what its reply is judged by."""

    deadline_s: float
    floor: Receipt | None = None  # of the client, if the query names it


@dataclass(frozen=True, slots=True)
class Pause:
    """A step: wait. It has no outcome."""

    seconds: float


#: The steps to a result. An error of a step is raised where the generator yielded it.
Steps = Generator[Ask | Pause, Any, T]


def decode(outcome: bytes | NoReply) -> wire.Message | NoReply:
    """The message in the outcome of a query. Raises ProtocolError if it is malformed."""
    return outcome if isinstance(outcome, NoReply) else wire.unpack(outcome, wire.MAX_REPLY_BYTES)
