"""Exchanges of a client that a test answers, step by step and without I/O."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from zenoh_tf import wire
from zenoh_tf._net.queries import NoReply
from zenoh_tf.errors import ServerBusy, TransformException
from zenoh_tf.steps import Ask, Pause, Steps
from zenoh_tf_client.requests import writes
from zenoh_tf_client.session import retries
from zenoh_tf_client.session.exchange import Exchange

TIMEOUT_S = 5.0
SERVER_AHEAD_NS = 10**15
Reply = Callable[[str, wire.Message], Any]


def hello(instance: str = "one", **limits: int) -> wire.Message:
    clock_ns = time.monotonic_ns() + SERVER_AHEAD_NS
    limits = {"message_bytes": wire.MAX_MESSAGE_BYTES, "rows": 100_000} | limits
    value = {"tree": "main", "instance": instance, "clock_ns": clock_ns, "limits": limits}
    return {"v": 1, "instance": instance, "value": value}


def done(value: object = None, instance: str = "one", **more: Any) -> wire.Message:
    return {"v": 1, "instance": instance, "value": value, **more}


def failed(error: TransformException, instance: str = "one") -> wire.Message:
    return wire.error_reply(instance, error)


class Clock:
    """The time of an exchange, which advances with queries and pauses only."""

    QUERY_S = 1.0

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def monotonic_ns(self) -> int:
        return round(self.now_s * 1e9)

    def time_ns(self) -> int:
        return 10**18


class Random:
    """Makes a pause of `retry_after_s` three times as long."""

    def uniform(self, low: float, high: float) -> float:
        return low + high


def stop_time(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Give the exchange a clock that only a test moves."""
    found = Clock()
    monkeypatch.setattr(sys.modules[Exchange.__module__], "time", found)
    monkeypatch.setattr(retries, "time", found)
    monkeypatch.setattr(retries, "random", Random())
    return found


class Script:
    """Answers the queries of an exchange in turn, and keeps them."""

    def __init__(self, *replies: Any, clock: Clock | None = None) -> None:
        self._replies = list(replies)
        self._clock = clock
        self.asked: list[tuple[str, wire.Message]] = []  # key without the tree, and message
        self.timeouts_s: list[float] = []
        self.pauses_s: list[float] = []

    def run(self, steps: Steps[Any]) -> Any:
        outcome: Any = None
        while True:
            try:
                step = steps.send(outcome)
            except StopIteration as end:
                assert not self._replies, "it asked too little"
                return end.value
            if isinstance(step, Pause):
                self.pauses_s.append(step.seconds)
                if self._clock is not None:
                    self._clock.now_s += step.seconds
                outcome = None
                continue
            assert isinstance(step, Ask)
            outcome = self.ask(step.key, step.payload, step.timeout_s)

    def ask(self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float) -> bytes | NoReply:
        """Answer a query, as `Queries.ask`."""
        self.asked.append((str(key).removeprefix("tf/v1/main/"), wire.unpack(payload)))
        self.timeouts_s.append(timeout_s)
        if self._clock is not None:
            self._clock.now_s += self._clock.QUERY_S
        reply = self._replies.pop(0)
        return wire.pack(reply) if isinstance(reply, dict) else reply

    @property
    def keys(self) -> list[str]:
        return [key for key, _ in self.asked]


def greeted(**limits: Any) -> Exchange:
    """An exchange that knows its server, and when it last asked for the clock."""
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    Script(hello(**limits)).run(exchange.greet())
    exchange.next_hello_s = time.monotonic() + 1000
    return exchange


def no_reply(at_once: bool = False) -> Any:
    return NoReply("nothing came", at_once)


WRITE = writes.clear()


def new(clock: Clock, *, moves: bool = False, **limits: Any) -> Exchange:
    """An exchange that has just greeted its server. The clock of the server is far ahead.
    `moves`: it has several endpoints."""
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S, moves=moves)
    Script(hello_at(clock, **limits), clock=clock).run(exchange.greet())
    exchange.next_hello_s = 1e9
    return exchange


def hello_at(
    clock: Clock, instance: str = "one", access: Any = None, **limits: int
) -> wire.Message:
    """A reply to `hello` by a server whose clock is ahead by SERVER_AHEAD_NS."""
    reply = hello(instance, **limits)
    reply["value"]["clock_ns"] = round((clock.now_s + clock.QUERY_S) * 1e9) + SERVER_AHEAD_NS
    if access is not None:
        reply["value"]["access"] = access
    return reply


def busy(retry_after_s: float | None) -> wire.Message:
    return failed(ServerBusy("busy", retry_after_s=retry_after_s))
