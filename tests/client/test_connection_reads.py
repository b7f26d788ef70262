"""Blocking calls make most reads without steps: with the same outcome, whatever the server does."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import pytest

from tests.support.exchanges import (
    TIMEOUT_S,
    Clock,
    Script,
    busy,
    failed,
    hello_at,
    new,
    no_reply,
    stop_time,
)
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._core import pack_single_lookup
from zenoh_tf._net.queries import Queries
from zenoh_tf.errors import LookupException
from zenoh_tf_client.requests import lookups
from zenoh_tf_client.requests.request import Request
from zenoh_tf_client.session.exchange import Exchange

LOOKUP = lookups.lookup_transform("map", "base")
WAITING = lookups.lookup_transform("map", "base", None, 2.0)
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


def answer(instance: str = "one") -> wire.Message:
    return wire.one_answer(7, None, POSE) | {"v": 1, "instance": instance}


class Steps(Script):
    """Takes the steps of the exchange."""

    def read(self, exchange: Exchange, request: Request[Any]) -> Any:
        return self.run(exchange.steps(request))


class Straight(Script):
    """Reads by blocking calls."""

    def read(self, exchange: Exchange, request: Request[Any]) -> Any:
        exchange.queries = cast(Queries, self)
        result = exchange.call(request)
        assert not self._replies, "it asked too little"
        return result


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = stop_time(monkeypatch)

    def sleep(seconds: float) -> None:
        found.now_s += seconds

    monkeypatch.setattr(found, "sleep", sleep, raising=False)
    return found


def outcome(script: Script, read: Callable[[], Any]) -> tuple[Any, ...]:
    try:
        result = repr(read())
    except Exception as error:
        result = repr(error)
    return result, script.asked, script.timeouts_s


def known(clock: Clock) -> Exchange:
    return new(clock)


def with_hello_due(clock: Clock) -> Exchange:
    exchange = new(clock)
    exchange.next_hello_s = clock.now_s
    return exchange


def without_server(clock: Clock) -> Exchange:
    exchange = new(clock)
    exchange.server = None
    return exchange


def with_several_endpoints(clock: Clock) -> Exchange:
    return new(clock, moves=True)


def with_rules(clock: Clock) -> Exchange:
    exchange = Exchange("main", "tcp/127.0.0.1:1", "ada", TIMEOUT_S)
    access: Any = {"may": [], "publish": []}
    Script(hello_at(clock, access=access), clock=clock).run(exchange.greet())
    exchange.next_hello_s = 1e9
    return exchange


def with_a_short_limit(clock: Clock) -> Exchange:
    return new(clock, message_bytes=10)


@pytest.mark.parametrize("request_", [LOOKUP, WAITING], ids=["lookup", "waiting"])
@pytest.mark.parametrize(
    ("make", "replies"),
    [
        (known, [answer()]),
        (known, [failed(LookupException("no frame"))]),
        (known, [failed(LookupException("no frame"), "two")]),
        (known, [busy(0.1), answer()]),
        (known, [busy(10.0)]),
        (known, [no_reply()]),
        (known, [no_reply(at_once=True), no_reply()]),
        (known, [answer("two")]),
        (known, [b"\xc1"]),
        (with_hello_due, [answer(), "hello"]),
        (with_hello_due, [failed(LookupException("no frame")), "hello"]),
        (without_server, [answer()]),
        (without_server, [no_reply()]),
        (with_several_endpoints, [answer() | {"seq": 3}]),
        (with_rules, []),
        (with_a_short_limit, []),
    ],
)
def test_a_read_has_the_outcome_of_the_steps(
    clock: Clock, make: Callable[[Clock], Exchange], replies: list[Any], request_: Request[Any]
) -> None:
    found = []
    for kind in (Steps, Straight):
        clock.now_s = 1000.0
        exchange = make(clock)
        greeting = hello_at(clock)
        given = [greeting if reply == "hello" else reply for reply in replies]
        script = kind(*given, clock=clock)
        results = outcome(script, partial(script.read, exchange, request_))
        server = exchange.server and exchange.server.instance
        for _, body in script.asked:
            body.pop("clock_ns", None)
        found.append((*results, server, exchange.floor.value, clock.now_s))
    steps, straight = found
    assert straight == steps


def test_a_read_takes_no_step(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    def steps(*_: object) -> None:
        raise AssertionError("it took steps")

    monkeypatch.setattr(Exchange, "run", steps)
    script = Straight(answer(), clock=clock)
    found = script.read(new(clock), LOOKUP)
    assert found == StampedTransform("map", "base", 7, Transform.from_pose(POSE))
    packed = pack_single_lookup("map", "base", wire.OP_COMMON, wire.NO_STAMP)
    assert packed is not None and script.asked == [("lookup", wire.unpack(packed))]
    assert script.timeouts_s == [TIMEOUT_S]
