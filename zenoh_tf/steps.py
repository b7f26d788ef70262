"""Steps: what a routine waits for that sends queries, and the two drivers that take them.

A routine is a generator. It yields a step, is sent the outcome, and returns its result; an error of
a step is raised where the routine yielded it. So what a routine decides is without I/O, and the
same for callers that block (`run`) and for event loops (`LoopSteps`).

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import zenoh

from . import wire
from ._net.queries import NoReply
from .errors import TransformException

if TYPE_CHECKING:
    import asyncio

T = TypeVar("T")


@dataclass(slots=True)  # a frozen one takes three times as long to make
class Ask:
    """A step: send a query. Its outcome is the reply's bytes, or a `NoReply`."""

    key: zenoh.KeyExpr
    payload: bytes
    timeout_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """A step: wait. Its outcome is whether the routine is to end, as nobody needs it any more."""

    seconds: float


Steps = Generator[Ask | Pause, Any, T]

#: What arrives for a query: the reply's bytes, or why there is none.
Outcome = bytes | NoReply | TransformException


def decode(outcome: bytes | NoReply) -> wire.Message | NoReply:
    """The message in the outcome of a query. Raises ProtocolError if it is malformed."""
    return outcome if isinstance(outcome, NoReply) else wire.unpack(outcome, wire.MAX_REPLY_BYTES)


def run(steps: Steps[T], take: Callable[[Ask | Pause], object]) -> T:
    """Take steps one after another in this thread, and return their result."""
    outcome: object = None
    error: Exception | None = None
    while True:
        try:
            step = steps.send(outcome) if error is None else steps.throw(error)
        except StopIteration as end:
            result: T = end.value
            return result
        outcome = error = None
        try:
            outcome = take(step)
        except Exception as failure:
            error = failure


class Sent(Protocol):
    """A query that was sent."""

    def cancel(self) -> None:
        """Forget the query: nothing arrives for it any more."""


class Sender(Protocol):
    """Sends queries from an event loop, without waiting."""

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The loop."""

    def send(self, step: Ask, arrived: Callable[[Outcome], None]) -> Sent | None:
        """Send a query. The loop calls `arrived` with its outcome, later and once. None: it cannot
        be cancelled."""


class LoopSteps(ABC):
    """Takes the steps of one routine on an event loop, without a task of its own: a loop that is
    closed in the middle has nothing to clean up. Thread safety: the loop's thread."""

    __slots__ = ("_query", "_sender", "_steps", "_timer")

    def __init__(self, sender: Sender, steps: Steps[Any]) -> None:
        self._sender = sender
        self._steps = steps
        self._query: Sent | None = None
        self._timer: asyncio.TimerHandle | None = None

    @abstractmethod
    def _done(self, result: Any, error: Exception | None) -> None:
        """Use the result or the error."""

    def _is_over(self) -> bool:
        """The outcome of a pause."""
        return False

    def start(self) -> None:
        """Take the first steps, up to a query or a pause."""
        self._continue(None)

    def end(self, reason: str) -> None:
        """Continue as if no reply came."""
        self._stop_waiting()
        self._continue(NoReply(reason, at_once=False))

    def _cancel(self) -> None:
        """Leave nothing behind. `_done` is not called."""
        self._stop_waiting()
        self._steps.close()

    def _continue(self, outcome: object) -> None:
        try:
            if isinstance(outcome, TransformException):
                step = self._steps.throw(outcome)
            else:
                step = self._steps.send(outcome)
        except StopIteration as end:
            self._done(end.value, None)
        except Exception as failure:
            self._done(None, failure)
        else:
            if isinstance(step, Pause):
                self._timer = self._sender.loop.call_later(step.seconds, self._paused)
            else:
                self._query = self._sender.send(step, self._arrived)

    def _paused(self) -> None:
        self._continue(self._is_over())

    def _arrived(self, outcome: Outcome) -> None:
        self._query = None
        self._continue(outcome)

    def _stop_waiting(self) -> None:
        if self._query is not None:
            self._query.cancel()
        if self._timer is not None:
            self._timer.cancel()
        self._query = self._timer = None
