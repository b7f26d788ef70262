"""The decisions of the client's exchange, step by step and without I/O: when a request is sent
again, to whom, and what a missing reply means."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tests.support.exchanges import (
    SERVER_AHEAD_NS,
    TIMEOUT_S,
    WRITE,
    Clock,
    Script,
    busy,
    done,
    failed,
    greeted,
    hello,
    hello_at,
    new,
    no_reply,
    stop_time,
)
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf.errors import (
    AccessDenied,
    LimitExceeded,
    LookupException,
    OutcomeUnknown,
    ServerBusy,
    ServerRestarted,
    ServerUnavailable,
)
from zenoh_tf_client.requests import columns, info, writes
from zenoh_tf_client.session.exchange import Exchange


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return stop_time(monkeypatch)


def test_a_read_is_one_query() -> None:
    script = Script(done(["map"]))
    assert script.run(greeted().steps(info.frames())) == ["map"]
    assert (script.keys, script.pauses_s) == (["info"], [])
    assert 0 < script.timeouts_s[0] <= TIMEOUT_S


def test_an_error_is_raised_and_not_asked_again() -> None:
    script = Script(failed(LookupException("no frame")))
    with pytest.raises(LookupException, match="no frame"):
        script.run(greeted().steps(info.frames()))
    assert script.keys == ["info"]


def test_a_busy_server_is_asked_again_within_the_time() -> None:
    busy = failed(ServerBusy("busy", retry_after_s=0.5))
    script = Script(busy, busy, done(["map"]))
    assert script.run(greeted().steps(info.frames())) == ["map"]
    assert script.keys == 3 * ["info"]
    assert all(0.5 <= pause_s <= 1.0 for pause_s in script.pauses_s) and len(script.pauses_s) == 2
    assert all(limit_s < TIMEOUT_S - 0.4 for limit_s in script.timeouts_s[1:])
    for retry_after_s in (2 * TIMEOUT_S, None, -1.0):  # too late, or not to be repeated
        script = Script(failed(ServerBusy("busy", retry_after_s=retry_after_s)))
        with pytest.raises(ServerBusy):
            script.run(greeted().steps(info.frames()))
        assert script.pauses_s == []


def test_a_read_that_was_refused_until_its_time_was_over_is_refused() -> None:
    exchange = greeted()
    with pytest.raises(ServerBusy):  # the last query had no time for a reply
        Script(busy(0.01), busy(0.01), no_reply()).run(exchange.steps(info.frames()))
    assert exchange.server is None
    with pytest.raises(OutcomeUnknown):  # but it may have been applied
        Script(busy(0.01), no_reply()).run(greeted().steps(WRITE))


def test_no_reply_leaves_only_a_writes_outcome_open() -> None:
    exchange = greeted()
    with pytest.raises(ServerUnavailable, match="nothing came"):
        Script(no_reply()).run(exchange.steps(info.frames()))
    assert exchange.server is None
    exchange = greeted()
    with pytest.raises(OutcomeUnknown, match="nothing came"):
        Script(no_reply()).run(exchange.steps(WRITE))
    assert exchange.server is None
    with pytest.raises(ServerUnavailable):  # the server is asked first, so nothing was sent
        Script(no_reply()).run(exchange.steps(WRITE))


def test_a_refused_write_keeps_its_id_and_expiry() -> None:
    script = Script(failed(ServerBusy("busy", retry_after_s=0.01)), done(seq=1))
    script.run(greeted().steps(WRITE))
    (_, first), (_, second) = script.asked
    assert first == second


def test_a_write_for_a_server_that_was_restarted_goes_to_the_next_one() -> None:
    restarted = failed(ServerRestarted("it is another one"), "two")
    script = Script(restarted, hello("two"), done(seq=1, instance="two"))
    script.run(greeted().steps(WRITE))
    assert script.keys == ["admin", "hello", "admin"]
    assert [body["instance"] for key, body in script.asked if key == "admin"] == ["one", "two"]
    script = Script(restarted, hello("two"), restarted)
    with pytest.raises(ServerRestarted):
        script.run(greeted().steps(WRITE))


def test_another_instance_is_greeted_before_the_next_write() -> None:
    exchange = greeted()
    Script(done(["map"], "two")).run(exchange.steps(info.frames()))
    assert exchange.server is None
    script = Script(hello("two"), done(seq=1, instance="two"))
    script.run(exchange.steps(WRITE))
    assert script.keys == ["hello", "admin"]


# --- times


def test_how_long_queries_and_pauses_may_take(clock: Clock) -> None:
    exchange = new(clock)
    for wait_s in (0.0, 2.0):
        call = replace(info.frames(), wait_s=wait_s)  # type: ignore[type-var]
        script = Script(busy(0.25), done(["map"]), clock=clock)
        script.run(exchange.steps(call))
        left_s = TIMEOUT_S + wait_s - 1.0 - 0.75
        assert (script.timeouts_s, script.pauses_s) == ([TIMEOUT_S + wait_s, left_s], [0.75])
    script = Script(busy(0.25), done(), clock=clock)
    script.run(exchange.steps(WRITE))
    assert script.timeouts_s == pytest.approx([TIMEOUT_S, TIMEOUT_S - 1.75])
    script = Script(
        busy((TIMEOUT_S - 1.5) / 3), done(["map"]), clock=clock
    )  # half a second is left
    script.run(exchange.steps(info.frames()))
    assert script.timeouts_s[1] == pytest.approx(0.5)
    for late_s in (0.0, 0.3):  # no time is left
        script = Script(busy((TIMEOUT_S - 1.0 + late_s) / 3), clock=clock)
        with pytest.raises(ServerBusy):
            script.run(exchange.steps(info.frames()))
        assert script.pauses_s == []
    script = Script(busy(0.0), done(["map"]), clock=clock)  # at once
    script.run(exchange.steps(info.frames()))
    assert script.pauses_s == [0.0]


def test_the_clock_is_asked_for_after_a_second_then_every_ten(clock: Clock) -> None:
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    begin_s = clock.now_s
    clock.QUERY_S = 0.25
    script = Script(hello_at(clock), clock=clock)
    script.run(exchange.greet())
    assert script.timeouts_s == [TIMEOUT_S] and "round_trip_ns" not in script.asked[0][1]
    for period_s in (1.0, 10.0, 10.0):
        clock.now_s = begin_s + period_s - 0.375
        script = Script(done(["map"]), clock=clock)
        script.run(exchange.steps(info.frames()))
        clock.now_s = begin_s + period_s - 0.25  # when the reply is there, it is time
        script = Script(done(["map"]), hello_at(clock), clock=clock)
        script.run(exchange.steps(info.frames()))
        assert script.keys == ["info", "hello"] and script.timeouts_s[1] == 0.5
        assert script.asked[1][1]["round_trip_ns"] == 250_000_000
        begin_s += period_s
    clock.now_s = begin_s + 10.0
    script = Script(hello_at(clock), done(), clock=clock)
    script.run(exchange.steps(WRITE))
    assert script.keys == ["hello", "admin"]
    clock.now_s += 20.0  # a read is answered all the same
    script = Script(done(["map"]), no_reply(), clock=clock)
    assert script.run(exchange.steps(info.frames())) == ["map"]
    assert exchange.server is None


def test_the_expiry_of_a_write_is_exact(clock: Clock) -> None:
    exchange = new(clock)
    ids = []
    for _ in range(2):
        now_ns = clock.monotonic_ns()
        script = Script(done(seq=3), clock=clock)
        script.run(exchange.steps(WRITE))
        ((key, body),) = script.asked
        assert (key, body["instance"]) == ("admin", "one")
        assert body["expires_ns"] == now_ns + SERVER_AHEAD_NS + int(TIMEOUT_S * 1e9)
        ids.append(body["id"])
    assert [int.from_bytes(each[8:], "big") for each in ids] == [0, 1]
    assert exchange.last_receipt is not None and exchange.last_receipt.seq == 3
    assert {len(each) for each in ids} == {16} and len({each[:8] for each in ids}) == 1


def test_a_message_as_long_as_the_limit_is_sent(clock: Clock) -> None:
    length = len(wire.pack(info.frames().body()))
    script = Script(done(["map"]), clock=clock)
    script.run(new(clock, message_bytes=length).steps(info.frames()))
    with pytest.raises(LimitExceeded) as caught:
        Script().run(new(clock, message_bytes=length - 1).steps(info.frames()))
    error = caught.value
    assert (error.field, error.limit, error.value) == ("message_bytes", length - 1, length)


# --- another instance, and rights

DENIED: Any = {"may": [], "publish": []}


@pytest.mark.parametrize("other", ["a", "z"])
def test_a_reply_of_another_instance_is_not_the_known_servers(other: str) -> None:
    exchange = greeted()
    assert Script(done(["map"], other)).run(exchange.steps(info.frames())) == ["map"]
    assert exchange.server is None
    exchange = greeted()
    Script(done(["map"])).run(exchange.steps(info.frames()))
    assert exchange.server is not None


def test_a_write_for_one_instance_goes_to_no_other() -> None:
    rows = columns.commit([StampedTransform("map", "base", 1, Transform())], "", False)
    exchange = greeted()
    script = Script(failed(ServerRestarted("it is another one"), "two"))
    with pytest.raises(ServerRestarted):
        script.run(exchange.steps(writes.commit(rows, "one")))
    assert (script.keys, exchange.server) == (["commit"], None)
    script = Script(hello("two"), failed(ServerRestarted("it is another one"), "two"))
    with pytest.raises(ServerRestarted):
        script.run(exchange.steps(writes.commit(rows, "one")))
    assert script.asked[1][1]["instance"] == "one"


def test_rights_are_checked_before_a_request_is_sent(clock: Clock) -> None:
    exchange = Exchange("main", "tcp/127.0.0.1:1", "ada", TIMEOUT_S)
    Script(hello_at(clock, access=DENIED), clock=clock).run(exchange.greet())
    exchange.next_hello_s = 1e9
    for request in (WRITE, info.frames()):
        with pytest.raises(AccessDenied, match="user 'ada' may not"):
            Script().run(exchange.steps(request))
    rights = {"may": ["clear", "read"], "publish": []}
    Script(hello_at(clock, access=rights), clock=clock).run(exchange.greet())
    exchange.next_hello_s = 1e9
    read, write = Script(done(["map"]), clock=clock), Script(done(), clock=clock)
    read.run(exchange.steps(info.frames()))
    write.run(exchange.steps(WRITE))
    assert (read.keys, write.keys) == (["info"], ["admin/clear"])
    Script(hello_at(clock), clock=clock).run(exchange.greet())  # without rules
    assert exchange.access is None


def test_a_request_that_ends_at_once_may_be_denied_by_now(clock: Clock) -> None:
    for request, failure in ((WRITE, OutcomeUnknown), (info.frames(), ServerUnavailable)):
        denied = hello_at(clock, access=DENIED)
        script = Script(no_reply(at_once=True), denied)
        with pytest.raises(AccessDenied):
            script.run(greeted().steps(request))
        assert script.keys[1] == "hello"
        for reply in (hello_at(clock), no_reply()):  # still allowed, or not known
            with pytest.raises(failure, match="nothing came"):
                Script(no_reply(at_once=True), reply).run(greeted().steps(request))
        with pytest.raises(failure, match="nothing came"):  # the server may hang
            Script(no_reply()).run(greeted().steps(request))
    script = Script(no_reply(at_once=True), denied)
    with pytest.raises(AccessDenied):
        script.run(greeted().steps(WRITE))
    assert script.timeouts_s[1] == 0.5
    for other in ("a", "z"):  # whose rules say nothing of the one that got the write
        with pytest.raises(OutcomeUnknown):
            Script(no_reply(at_once=True), hello_at(clock, other, DENIED)).run(
                greeted().steps(WRITE)
            )
    rows = columns.commit([StampedTransform("map", "base", 1, Transform())], "", False)
    for instance, outcome in (("one", AccessDenied), ("two", OutcomeUnknown)):
        with pytest.raises(outcome):
            Script(no_reply(at_once=True), hello_at(clock, access=DENIED)).run(
                greeted().steps(writes.commit(rows, instance))
            )
