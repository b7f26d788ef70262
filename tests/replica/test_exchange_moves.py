"""The decisions of the exchange of a client with several endpoints: what its requests must see, and
how long it waits for another server."""

from __future__ import annotations

import pytest

from tests.support.exchanges import (
    TIMEOUT_S,
    WRITE,
    Clock,
    Script,
    busy,
    done,
    failed,
    hello_at,
    new,
    no_reply,
    stop_time,
)
from zenoh_tf import wire
from zenoh_tf.errors import OutcomeUnknown, ReadOnlyReplica, ServerUnavailable
from zenoh_tf_client.requests import info
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.requests.request import Call
from zenoh_tf_client.session.exchange import Exchange
from zenoh_tf_client.session.floor import Floor

FRAMES = info.frames()
NOTHING = Receipt("", 0)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return stop_time(monkeypatch)


def floors(script: Script) -> list[wire.Message | None]:
    return [body.get(wire.FLOOR) for _, body in script.asked]


def test_each_request_says_what_the_client_has_seen(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    script = Script(done(["map"], seq=7), done(seq=9), done(["map"], seq=9), clock=clock)
    for request in (FRAMES, WRITE, FRAMES):
        _take(exchange, script, request)
    assert floors(script) == [
        {"instance": "", "seq": 0},
        {"instance": "one", "seq": 7},
        {"instance": "one", "seq": 9},
    ]
    assert exchange.floor.value == exchange.last_receipt == Receipt("one", 9)
    alone = new(clock)
    script = Script(done(["map"]), done(seq=9), done(["map"]), clock=clock)
    for request in (FRAMES, WRITE, FRAMES):
        _take(alone, script, request)
    assert floors(script) == [None, None, None]  # its only server has all that it has seen


def _take(exchange: Exchange, script: Script, request: object) -> None:
    """Run one request of several that a script answers."""
    rest, script._replies[1:] = script._replies[1:], []
    script.run(exchange.steps(request))  # type: ignore[arg-type]
    script._replies = rest


def test_a_request_may_name_another_commit(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    Script(done(["map"], seq=7)).run(exchange.steps(FRAMES))
    body = wire.call_body("frames") | wire.floor_field("one", 3)
    script = Script(done(seq=3), clock=clock)
    script.run(exchange.steps(Call("info", body, lambda reply: None)))
    assert floors(script) == [{"instance": "one", "seq": 3}]
    assert exchange.floor.value == Receipt("one", 7)


def test_a_server_that_is_behind_is_asked_again(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    Script(done(["map"], seq=7)).run(exchange.steps(FRAMES))
    script = Script(busy(0.1), busy(0.1), done(["map"], seq=7, age_ns=2 * 10**9), clock=clock)
    script.run(exchange.steps(FRAMES))
    assert script.pauses_s == pytest.approx([0.3, 0.3])
    assert exchange.age_s == 2.0
    Script(done(["map"], seq=7), clock=clock).run(exchange.steps(FRAMES))
    assert exchange.age_s is None


def test_the_floor_rises_and_corrects_itself() -> None:
    floor = Floor()
    first = floor.value
    floor.record({"instance": "one", "seq": 5}, first)
    now = floor.value
    for reply, before in (
        ({"instance": "one", "seq": 4}, first),  # asked for before
        ({"instance": "zero", "seq": 99}, first),  # of a server of the past
        ({"instance": "zero", "seq": 99}, None),
        ({"instance": "one", "seq": "x"}, now),
        ({"instance": "one"}, now),
    ):
        floor.record(reply, before)
        assert floor.value == Receipt("one", 5)
    floor.record({"instance": "one", "seq": 6}, first)
    assert floor.value == Receipt("one", 6)
    floor.record({"instance": "two", "seq": 1}, floor.value)  # asked for after: a new server
    assert floor.value == Receipt("two", 1)
    floor.record({"instance": "two", "seq": 1 << 62}, floor.value)
    floor.record({"instance": "two", "seq": 3}, floor.value)  # the number before was forged
    assert floor.value == Receipt("two", 3)


def test_a_read_waits_for_another_link_until_its_time_is_over(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    clock.QUERY_S = 0.4
    gone = [no_reply(at_once=True)] * 4  # after the first, the server is looked for each time
    script = Script(*gone, done(["map"], "two", seq=1), clock=clock)
    assert script.run(exchange.steps(FRAMES)) == ["map"]
    assert exchange.floor.value == Receipt("two", 1)
    with pytest.raises(ServerUnavailable):
        Script(*[no_reply(at_once=True)] * 99, clock=clock).run(exchange.steps(FRAMES))
    begin_s = clock.now_s
    with pytest.raises(ServerUnavailable):  # it hangs, and is not asked twice
        Script(no_reply(), clock=clock).run(exchange.steps(FRAMES))
    assert clock.now_s - begin_s < TIMEOUT_S


def test_a_write_waits_for_another_link_but_is_never_sent_twice(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    exchange.server = None
    script = Script(no_reply(at_once=True), hello_at(clock, "two"), done(seq=1, instance="two"))
    script.run(exchange.steps(WRITE))
    assert script.keys == ["hello", "hello", "admin"]
    script = Script(no_reply(at_once=True), hello_at(clock, "three"), clock=clock)
    with pytest.raises(OutcomeUnknown):
        script.run(exchange.steps(WRITE))
    assert script.keys == ["admin", "hello"]


def test_a_write_where_none_is_accepted(clock: Clock) -> None:
    exchange = new(clock, moves=True)
    script = Script(failed(ReadOnlyReplica("no", value="tcp/primary:1")), clock=clock)
    with pytest.raises(ReadOnlyReplica) as refusal:
        script.run(exchange.steps(WRITE))
    assert refusal.value.value == "tcp/primary:1" and len(script.asked) == 1
    greeting = hello_at(clock)
    greeting["value"]["primary"] = "tcp/primary:1"
    server = Script(greeting, clock=clock).run(exchange.greet())
    with pytest.raises(ReadOnlyReplica, match="tcp/primary:1"):
        server.raise_read_only()
