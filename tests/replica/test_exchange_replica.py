"""The decisions of the client's exchange where a replica answers reads: whom it asks, what the
reply must have seen, and what a missing reply means."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import pytest

from tests.support.exchanges import (
    TIMEOUT_S,
    WRITE,
    Clock,
    Script,
    done,
    failed,
    greeted,
    hello,
    hello_at,
    new,
    no_reply,
    stop_time,
)
from zenoh_tf import wire
from zenoh_tf.errors import AccessDenied, ReplicaBehind, ServerUnavailable
from zenoh_tf_client.requests import info
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.requests.request import Call
from zenoh_tf_client.session.exchange import Exchange


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return stop_time(monkeypatch)


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
    assert script.run(exchange.call(info.frames())) == ["map"]
    assert script.keys == ["at/0af3/info"] and exchange.replica_age_s == 2.0
    Script(done(seq=9)).run(exchange.call(WRITE))
    assert exchange.seen.is_behind
    script = Script(failed(ReplicaBehind("not yet")), done(["map"], **NEAR))
    assert script.run(exchange.call(info.frames())) == ["map"]
    assert script.keys == 2 * ["at/0af3/info"] and len(script.pauses_s) == 1
    assert wire.least("one", 9).items() <= script.asked[0][1].items()
    assert not exchange.seen.is_behind


FRAMES = info.frames()
DENIED: Any = {"may": [], "publish": []}


def beside_replica(clock: Clock, **more: Any) -> Exchange:
    """An exchange that has found a replica, and knows the server, too."""
    exchange = new(clock)
    exchange.router = lambda: "0af3"
    Script(hello_at(clock, **more), clock=clock).run(exchange.greet())
    exchange._next_greeting_s = 1e9
    return exchange


def test_a_greeting_shares_its_time(clock: Clock) -> None:
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    script = Script(hello_at(clock), clock=clock)
    assert script.run(exchange.greet()).instance == "one"  # no router, so the server at once
    assert (script.keys, script.timeouts_s) == (["hello"], [TIMEOUT_S])
    assert exchange.replica is None and not exchange.reads_may_be_old
    exchange.router = lambda: "0af3"
    for timeout_s, limits_s in ((None, [TIMEOUT_S, TIMEOUT_S - 1]), (2.0, [2.0, 1.0])):
        script = Script(no_reply(at_once=True), hello_at(clock), clock=clock)
        script.run(exchange.greet(timeout_s))
        assert script.keys == ["at/0af3/hello", "hello"] and script.timeouts_s == limits_s
    clock.QUERY_S = 7.0  # nothing is left
    script = Script(failed(AccessDenied("no")), hello_at(clock), clock=clock)
    script.run(exchange.greet())
    assert script.timeouts_s == [TIMEOUT_S, 0.1] and exchange.replica is None
    script = Script(hello_at(clock), clock=clock)
    assert script.run(exchange.greet()).instance == "one"
    assert script.keys == ["at/0af3/hello"] and exchange.reads_may_be_old


def test_a_read_looks_for_a_replica_for_a_share_of_its_time(clock: Clock) -> None:
    clock.QUERY_S = 0.25
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    exchange.router = lambda: "0af3"
    script = Script(no_reply(at_once=True), hello_at(clock), done(["map"]), clock=clock)
    assert script.run(exchange.call(FRAMES)) == ["map"]
    assert script.keys == ["at/0af3/hello", "hello", "info"]
    assert script.timeouts_s == [TIMEOUT_S / 4, TIMEOUT_S / 4 - 0.25, TIMEOUT_S - 0.5]
    clock.QUERY_S = 3.0
    exchange.server = None
    script = Script(no_reply(), no_reply(), done(["map"]), clock=clock)
    assert script.run(exchange.call(FRAMES)) == ["map"]  # whoever answers
    assert script.timeouts_s[2] == 0.001
    clock.QUERY_S = 2 * TIMEOUT_S
    exchange = Exchange("main", "tcp/127.0.0.1:1", None, TIMEOUT_S)
    exchange.router = lambda: "0af3"
    script = Script(hello_at(clock), done(["map"]), hello_at(clock), clock=clock)
    assert script.run(exchange.call(FRAMES)) == ["map"]
    assert script.keys[:2] == ["at/0af3/hello", "at/0af3/info"] and script.timeouts_s[1] == 0.001
    clock.QUERY_S = 1.0
    exchange = new(clock)
    exchange.router = lambda: "0af3"
    script = Script(done(["map"]), clock=clock)  # the server is known, so nobody is looked for
    script.run(exchange.call(FRAMES))
    assert script.keys == ["info"]


def test_who_is_missing_is_said(clock: Clock) -> None:
    exchange = beside_replica(clock)
    with pytest.raises(ServerUnavailable, match=r"primary of tree 'main' .* tcp/127.0.0.1:1 ans"):
        Script(no_reply(), clock=clock).run(exchange.hello())
    exchange.replica = None
    with pytest.raises(ServerUnavailable, match=r"^nothing came$"):
        Script(no_reply(), clock=clock).run(exchange.hello())


def test_what_a_replica_does_not_answer_goes_to_the_server(clock: Clock) -> None:
    exchange = beside_replica(clock)
    script = Script(done([]), clock=clock)
    script.run(exchange.call(Call("missed", {"v": 1}, lambda reply: reply["value"])))
    assert script.keys == ["missed"] and exchange.replica is not None
    exchange.server = None
    script = Script(no_reply(at_once=True), done(["map"]), clock=clock)
    assert script.run(exchange.call(FRAMES)) == ["map"]
    assert script.keys == ["at/0af3/info", "info"] and exchange.replica is None
    assert script.timeouts_s == [TIMEOUT_S, TIMEOUT_S - 1.0]
    exchange = beside_replica(clock)
    script = Script(no_reply(), clock=clock)
    with pytest.raises(ServerUnavailable, match="nothing came"):  # it hangs
        script.run(exchange.call(FRAMES))
    assert script.keys == ["at/0af3/info"] and exchange.replica is None


def near(seq: int, age_ns: int = 0) -> dict[str, Any]:
    return {"replica": {"seq": seq, "age_ns": age_ns}}


def test_reads_of_a_replica_never_go_back(clock: Clock) -> None:
    exchange = beside_replica(clock)
    Script(done(["map"], **near(7, 2_500_000_000))).run(exchange.call(FRAMES))
    assert exchange.replica_age_s == 2.5 and exchange.seen.least == Receipt("one", 7)
    script = Script(done(["map"], **near(5)))  # its own affair: the request says what it must have
    script.run(exchange.call(FRAMES))
    assert wire.least("one", 7).items() <= script.asked[0][1].items()
    assert exchange.seen.least == Receipt("one", 7)
    behind = failed(ReplicaBehind("not yet")) | near(99)
    script = Script(*4 * [behind], done(["map"], seq=8), clock=clock)
    begin_s = clock.now_s
    script.run(exchange.call(FRAMES))
    assert script.pauses_s == [0.002, 0.008, 0.03]
    left_s = [TIMEOUT_S - 1.002, TIMEOUT_S - 2.01, TIMEOUT_S - 3.04, TIMEOUT_S - 4.04]
    assert script.timeouts_s == pytest.approx([TIMEOUT_S, *left_s])
    assert clock.now_s == pytest.approx(begin_s + 5.04)
    # What a replica has not shown was not read; the server's own reply was, and is awaited.
    assert exchange.seen.least == Receipt("one", 8) and exchange.seen.is_behind
    assert script.asked[4][1][wire.WITH_SEQ] is True
    Script(*4 * [behind], done(["map"], seq="x")).run(exchange.call(FRAMES))
    assert exchange.seen.least == Receipt("one", 8) and exchange.seen.is_behind
    Script(done(["map"], **near(8))).run(exchange.call(FRAMES))
    assert not exchange.seen.is_behind


def test_the_servers_numbers_count_only_after_a_replica(clock: Clock) -> None:
    exchange = new(clock)
    script = Script(done(["map"], seq=9))
    script.run(exchange.call(FRAMES))
    assert exchange.seen.least is None and wire.WITH_SEQ not in script.asked[0][1]
    exchange.reads_may_be_old = True  # there was one, and it has gone
    Script(done(["map"], seq=9)).run(exchange.call(FRAMES))
    assert exchange.seen.least == Receipt("one", 9) and not exchange.seen.is_behind


def test_a_forged_number_does_not_stay(clock: Clock) -> None:
    """The server's own reply corrects what a replica was made to say."""
    exchange = beside_replica(clock)
    for reach in (6, 1 << 62):
        reply = done(["map"], replica={"seq": 4, "reach": reach, "age_ns": 1})
        Script(reply).run(exchange.call(FRAMES))
        assert exchange.seen.least == Receipt("one", reach)
    exchange.replica = None
    Script(done(["map"], seq=9)).run(exchange.call(FRAMES))
    assert exchange.seen.least == Receipt("one", 9)


def test_a_replica_of_a_new_instance(clock: Clock) -> None:
    exchange = beside_replica(clock)
    before = exchange.replica
    assert before is not None
    Script(done(["map"], **near(1))).run(exchange.call(FRAMES))
    assert exchange.replica is before
    for other in ("a", "z"):
        Script(done(["map"], other, **near(1))).run(exchange.call(FRAMES))
        assert exchange.replica is not None and exchange.replica.server.instance == other
        assert exchange.replica.keys is before.keys
    reply = done(["map"], **near(1))
    del reply["instance"]
    with pytest.raises(Exception, match="instance"):
        Script(reply).run(exchange.call(FRAMES))
    assert exchange.replica.server.instance == "z"


def test_a_replica_is_greeted_again(clock: Clock) -> None:
    exchange = beside_replica(clock)
    Script(done(seq=3), clock=clock).run(exchange.call(WRITE))
    exchange.seen.awaited = None
    for router, awaits in (("0af3", False), ("0bbb", True), ("0aaa", True)):
        exchange._next_greeting_s = clock.now_s + 1.0
        exchange.router = partial(str, router)
        assert exchange.replica is not None
        key = str(exchange.replica.keys["info"]).removeprefix("tf/v1/main/")
        reply = done(["map"], **near(3))
        script = Script(reply, hello_at(clock), clock=clock)
        assert script.run(exchange.call(FRAMES)) == ["map"]
        assert script.keys == [key, f"at/{router}/hello"] and script.timeouts_s[1] == 0.5
        assert exchange.seen.is_behind == awaits  # a new one may be older than the one before
        exchange.seen.awaited = None
        # It began to ask when the reply was there.
        assert exchange._next_greeting_s == clock.now_s - 1.0 + 10.0
    exchange._next_greeting_s = clock.now_s + 1.5
    script = Script(done(["map"], **near(3)), clock=clock)
    script.run(exchange.call(FRAMES))
    exchange._next_greeting_s = 0.0
    script = Script(done(["map"], **near(3)), no_reply(at_once=True), clock=clock)
    script.run(exchange.call(FRAMES))
    assert exchange.replica is None


def test_a_client_without_a_replica_finds_one_that_comes(clock: Clock) -> None:
    for has_one in (False, True):
        exchange = beside_replica(clock) if has_one else new(clock)
        exchange.router = lambda: "0af3"
        exchange.next_hello_s = clock.now_s
        behind = [failed(ReplicaBehind("not yet"))] * 4 if has_one else []
        greeting = [] if has_one else [hello_at(clock)]
        script = Script(*behind, done(["map"]), hello_at(clock), *greeting, clock=clock)
        script.run(exchange.call(FRAMES))
        assert script.keys[len(behind) :] == ["info", "hello", *["at/0af3/hello"] * (not has_one)]
        assert script.timeouts_s[len(behind) + 1 :] == [0.5, *[0.5] * (not has_one)]
        assert exchange.replica is not None


def test_rights_at_a_replica_are_its_own(clock: Clock) -> None:
    exchange = beside_replica(clock, access=DENIED)
    assert exchange.access is not None
    Script(hello_at(clock), clock=clock).run(exchange.hello())
    assert exchange.access is not None  # the server's rules are for its own clients
    for answers in ([hello_at(clock, access=DENIED), hello_at(clock)], [no_reply(), no_reply()]):
        exchange = beside_replica(clock)
        script = Script(no_reply(at_once=True), *answers)
        with pytest.raises(Exception) as caught:
            script.run(exchange.call(WRITE))
        assert script.keys == ["admin", "at/0af3/hello", "hello"]
        assert script.timeouts_s[1:] == [0.5, 0.5]
        expected = "OutcomeUnknown" if exchange.replica is None else "AccessDenied"
        assert type(caught.value).__name__ == expected
