"""Runs the steps of an exchange on an event loop, without a task of its own.

A loop that is closed in the middle has nothing to clean up. A task would have.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from typing import Any

from zenoh_tf._net.queries import NoReply
from zenoh_tf.errors import TransformException

from ...session.steps import Pause, Steps
from .transport import Outcome, SentQuery, Transport


class Drive(ABC):
    """Runs the steps of one exchange."""

    __slots__ = ("_query", "_steps", "_timeout_s", "_timer", "_transport")

    def __init__(self, transport: Transport, steps: Steps[Any]) -> None:
        self._transport = transport
        self._steps = steps
        self._timeout_s = 0.0
        self._query: SentQuery | None = None
        self._timer: asyncio.TimerHandle | None = None

    @abstractmethod
    def _done(self, result: Any, error: Exception | None) -> None:
        """Use the result or the error."""

    def start(self) -> None:
        """Run the first steps, up to a query or a pause."""
        self._continue(None)

    def end(self, reason: str) -> None:
        """Continue as if no reply came."""
        self._stop_waiting()
        self._continue(NoReply(reason, at_once=False))

    def _cancel(self) -> None:
        """Leave nothing behind. `_done` is not called."""
        self._stop_waiting()
        self._steps.close()

    def _continue(self, outcome: object, error: TransformException | None = None) -> None:
        try:
            step = self._steps.send(outcome) if error is None else self._steps.throw(error)
        except StopIteration as end:
            self._done(end.value, None)
        except Exception as failure:
            self._done(None, failure)
        else:
            if isinstance(step, Pause):
                self._timer = self._transport.loop.call_later(step.seconds, self._continue, None)
            else:
                self._timeout_s = step.timeout_s
                self._query = self._transport.send(step, self._arrived)

    def _arrived(self, outcome: Outcome) -> None:
        self._query = None
        if isinstance(outcome, TransformException):
            self._continue(None, outcome)
            return
        self._continue(self._transport.opened.queries.outcome(outcome, self._timeout_s))

    def _stop_waiting(self) -> None:
        if self._query is not None:
            self._query.cancel()
        if self._timer is not None:
            self._timer.cancel()
        self._query = self._timer = None
