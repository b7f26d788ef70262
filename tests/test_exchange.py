"""The decisions of the client's exchange, step by step and without I/O: when a request is sent
again, to whom, and what a missing reply means."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from zenoh_tf import wire
from zenoh_tf.errors import (
    LimitExceeded,
    LookupException,
    OutcomeUnknown,
    ReplicaBehind,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
    TransformException,
)
from zenoh_tf.queries import NoReply
from zenoh_tf_client import info_requests, write_requests
from zenoh_tf_client.exchange import Exchange
from zenoh_tf_client.steps import Ask, Pause, Steps

TIMEOUT_S = 5.0
SERVER_AHEAD_NS = 10**15
Reply = Callable[[str, wire.Message], Any]


def hello(instance: str = "one", **limits: int) -> wire.Message:
    clock_ns = time.monotonic_ns() + SERVER_AHEAD_NS
    value = {"tree": "main", "instance": instance, "clock_ns": clock_ns, "limits": limits}
    return {"v": 1, "instance": instance, "value": value}


def done(value: object = None, instance: str = "one", **more: Any) -> wire.Message:
    return {"v": 1, "instance": instance, "value": value, **more}


def failed(error: TransformException, instance: str = "one") -> wire.Message:
    return wire.error_reply(instance, error)


class Script:
    """Answers the queries of an exchange in turn, and keeps them."""

    def __init__(self, *replies: Any) -> None:
        self._replies = list(replies)
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
                outcome = None
                continue
            assert isinstance(step, Ask)
            self.asked.append(
                (str(step.key).removeprefix("tf/v1/main/"), wire.unpack(step.payload))
            )
            self.timeouts_s.append(step.timeout_s)
            reply = self._replies.pop(0)
            outcome = wire.pack(reply) if isinstance(reply, dict) else reply

    @property
    def keys(self) -> list[str]:
        return [key for key, _ in self.asked]


def greeted(**limits: Any) -> Exchange:
    """An exchange that knows its server, and when it last asked for the clock."""
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    Script(hello(**limits)).run(exchange.hello())
    exchange._next_hello_s = time.monotonic() + 1000
    return exchange


def no_reply(at_once: bool = False) -> Any:
    return NoReply("nothing came", at_once)


WRITE = write_requests.clear()


def test_a_read_is_one_query() -> None:
    script = Script(done(["map"]))
    assert script.run(greeted().call(info_requests.frames())) == ["map"]
    assert (script.keys, script.pauses_s) == (["info"], [])
    assert 0 < script.timeouts_s[0] <= TIMEOUT_S


def test_an_error_is_raised_and_not_asked_again() -> None:
    script = Script(failed(LookupException("no frame")))
    with pytest.raises(LookupException, match="no frame"):
        script.run(greeted().call(info_requests.frames()))
    assert script.keys == ["info"]


def test_a_busy_server_is_asked_again_within_the_time() -> None:
    busy = failed(ServerBusy("busy", retry_after_s=0.5))
    script = Script(busy, busy, done(["map"]))
    assert script.run(greeted().call(info_requests.frames())) == ["map"]
    assert script.keys == 3 * ["info"]
    assert all(0.5 <= pause_s <= 1.0 for pause_s in script.pauses_s) and len(script.pauses_s) == 2
    assert all(limit_s < TIMEOUT_S - 0.4 for limit_s in script.timeouts_s[1:])
    for retry_after_s in (2 * TIMEOUT_S, None, -1.0):  # too late, or not to be repeated
        script = Script(failed(ServerBusy("busy", retry_after_s=retry_after_s)))
        with pytest.raises(ServerBusy):
            script.run(greeted().call(info_requests.frames()))
        assert script.pauses_s == []


def test_no_reply_leaves_only_a_writes_outcome_open() -> None:
    exchange = greeted()
    with pytest.raises(ServerUnavailable, match="nothing came"):
        Script(no_reply()).run(exchange.call(info_requests.frames()))
    assert exchange.server is None
    exchange = greeted()
    with pytest.raises(OutcomeUnknown, match="nothing came"):
        Script(no_reply()).run(exchange.call(WRITE))
    assert exchange.server is None
    with pytest.raises(ServerUnavailable):  # the server is asked first, so nothing was sent
        Script(no_reply()).run(exchange.call(WRITE))


def test_a_write_has_an_id_an_expiry_and_an_instance() -> None:
    exchange = greeted()
    ids = set()
    for _ in range(2):
        script = Script(done(seq=3))
        before_ns = time.monotonic_ns()
        script.run(exchange.call(WRITE))
        ((key, body),) = script.asked
        assert (key, body["instance"]) == ("admin", "one")
        ids.add(body["id"])
        left_ns = body["expires_ns"] - SERVER_AHEAD_NS - before_ns
        assert 0 < left_ns <= (TIMEOUT_S + 30) * 1e9
        assert left_ns > (TIMEOUT_S - 1) * 1e9
    assert len(ids) == 2
    assert exchange.seen.last_receipt is not None and exchange.seen.last_receipt.seq == 3


def test_a_refused_write_keeps_its_id_and_expiry() -> None:
    script = Script(failed(ServerBusy("busy", retry_after_s=0.01)), done(seq=1))
    script.run(greeted().call(WRITE))
    (_, first), (_, second) = script.asked
    assert first == second


def test_a_write_for_a_server_that_was_restarted_goes_to_the_next_one() -> None:
    restarted = failed(ServerRestarted("it is another one"), "two")
    script = Script(restarted, hello("two"), done(seq=1, instance="two"))
    script.run(greeted().call(WRITE))
    assert script.keys == ["admin", "hello", "admin"]
    assert [body["instance"] for key, body in script.asked if key == "admin"] == ["one", "two"]
    script = Script(restarted, hello("two"), restarted)
    with pytest.raises(ServerRestarted):
        script.run(greeted().call(WRITE))


def test_another_instance_is_greeted_before_the_next_write() -> None:
    exchange = greeted()
    Script(done(["map"], "two")).run(exchange.call(info_requests.frames()))
    assert exchange.server is None
    script = Script(hello("two"), done(seq=1, instance="two"))
    script.run(exchange.call(WRITE))
    assert script.keys == ["hello", "admin"]


def test_the_clock_is_asked_for_now_and_then() -> None:
    exchange = greeted()
    exchange._next_hello_s = 0.0
    script = Script(done(["map"]), hello())
    assert script.run(exchange.call(info_requests.frames())) == ["map"]
    assert script.keys == ["info", "hello"]
    exchange._next_hello_s = 0.0
    script = Script(hello(), done(seq=1))
    script.run(exchange.call(WRITE))
    assert script.keys == ["hello", "admin"]


def test_a_message_beyond_the_servers_limit_is_not_sent() -> None:
    script = Script()
    with pytest.raises(LimitExceeded) as caught:
        script.run(greeted(message_bytes=10).call(info_requests.frames()))
    assert (caught.value.field, caught.value.limit) == ("message_bytes", 10)
    assert script.asked == []


def with_replica() -> Exchange:
    exchange = greeted()
    exchange.router = lambda: "0af3"
    Script(hello()).run(exchange.greet())
    exchange._next_greeting_s = time.monotonic() + 1000
    return exchange


NEAR: dict[str, Any] = {"replica": {"seq": 7, "age_ns": 2 * 10**9}}


def test_a_replica_answers_reads_and_sees_the_clients_writes() -> None:
    exchange = with_replica()
    script = Script(done(["map"], **NEAR))
    assert script.run(exchange.call(info_requests.frames())) == ["map"]
    assert script.keys == ["at/0af3/info"] and exchange.replica_age_s == 2.0
    Script(done(seq=9)).run(exchange.call(WRITE))
    assert exchange.seen.is_behind
    script = Script(failed(ReplicaBehind("not yet")), done(["map"], **NEAR))
    assert script.run(exchange.call(info_requests.frames())) == ["map"]
    assert script.keys == 2 * ["at/0af3/info"] and len(script.pauses_s) == 1
    assert wire.least("one", 9).items() <= script.asked[0][1].items()
    assert not exchange.seen.is_behind


def test_the_server_answers_what_the_replica_lacks() -> None:
    exchange = with_replica()
    Script(done(seq=5)).run(exchange.call(WRITE))
    behind = failed(ReplicaBehind("not yet"))
    script = Script(*4 * [behind], done(["map"]))
    assert script.run(exchange.call(info_requests.frames())) == ["map"]
    assert script.keys == [*4 * ["at/0af3/info"], "info"] and len(script.pauses_s) == 3
    assert exchange.replica_age_s is None
    script = Script(*4 * [behind], no_reply())
    with pytest.raises(ReplicaBehind):
        script.run(exchange.call(info_requests.frames()))
