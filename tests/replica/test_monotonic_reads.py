"""Reads of one client never go back: it says what it has seen, and servers say what they showed."""

from __future__ import annotations

from typing import Any

from tests.conftest import ServerProcess
from tests.support.raw import raw
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests.info import stats
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.session.exchange import Exchange
from zenoh_tf_client.session.seen_states import SeenStates
from zenoh_tf_client.session.server_info import parse_server_info
from zenoh_tf_client.session.steps import Ask

LIMITS = {"instance": "one", "clock_ns": 1, "limits": {"message_bytes": 1 << 20, "rows": 1}}


def test_the_server_says_what_a_read_may_have_seen(server: ServerProcess) -> None:
    with raw(server.endpoint) as wires, server.connect() as tf:
        tf.set_transform(StampedTransform("map", "base", 1, Transform()))
        receipt = tf.last_receipt
        assert receipt is not None
        body = wire.one_read("map", "base", wire.OP_COMMON, wire.NO_STAMP)
        for request_type, message in (("lookup", body), ("info", wire.call_body("frames"))):
            reply = wires.query(request_type, message | {wire.WITH_SEQ: True})
            assert reply["seq"] == receipt.seq
            assert "seq" not in wires.query(request_type, message)


class Peers:
    """A replica and its primary, which answer an exchange's steps."""

    def __init__(self, monotonic: Exchange) -> None:
        self.exchange = monotonic
        self.asked: list[wire.Message] = []

    def read(self, replies: dict[str, wire.Message]) -> Any:
        """Let the exchange read `stats`; `replies` by the last two chunks of the key."""
        steps = self.exchange.call(stats())
        outcome: Any = None
        try:
            while True:
                step = steps.send(outcome)
                if not isinstance(step, Ask):
                    outcome = None
                    continue
                chunks = str(step.key).split("/")
                where = "near" if "at" in chunks else "far"
                if chunks[-1] == "hello":
                    outcome = wire.pack({"v": 1, "instance": "one", "value": LIMITS})
                    continue
                self.asked.append(wire.unpack(step.payload))
                reply = {"v": 1, "instance": "one", "value": {}} | replies[where]
                outcome = wire.pack(reply)
        except StopIteration as end:
            return end.value


def test_a_read_of_the_primary_binds_reads_of_a_replica() -> None:
    exchange = Exchange("main", "nowhere", None, 5.0)
    exchange.router = lambda: "abc"
    peers = Peers(exchange)
    near = {"replica": {"seq": 4, "reach": 6, "age_ns": 1}}
    peers.read({"near": near})
    assert exchange.seen.least == Receipt("one", 6)
    exchange.replica = None  # it has gone; the primary answers
    exchange.server = parse_server_info(LIMITS, 0)
    peers.read({"far": {"seq": 9}})
    assert peers.asked[-1][wire.WITH_SEQ] is True
    assert exchange.seen.least == Receipt("one", 9)
    exchange.server = None  # a replica is found again
    peers.read({"near": near})
    assert peers.asked[-1]["least_seq"] == 9
    assert exchange.seen.least == Receipt("one", 9)


def test_a_forged_number_does_not_stay() -> None:
    """The server's own reply corrects what a replica was made to say."""
    exchange = Exchange("main", "nowhere", None, 5.0)
    exchange.router = lambda: "abc"
    peers = Peers(exchange)
    peers.read({"near": {"replica": {"seq": 4, "reach": 1 << 62, "age_ns": 1}}})
    exchange.replica = None
    exchange.server = parse_server_info(LIMITS, 0)
    peers.read({"far": {"seq": 9}})
    assert exchange.seen.least == Receipt("one", 9)


def test_a_client_without_a_replica_asks_for_no_number() -> None:
    exchange = Exchange("main", "nowhere", None, 5.0)
    exchange.server = parse_server_info(LIMITS, 0)
    peers = Peers(exchange)
    peers.read({"far": {}})
    assert wire.WITH_SEQ not in peers.asked[0]
    assert exchange.seen.least is None


def test_memory_is_not_read_until_the_replica_has_replied() -> None:
    seen = SeenStates()
    reported: list[bool] = []
    seen.on_behind = lambda: reported.append(seen.is_behind)
    seen.await_replica()
    assert reported == []  # nothing was seen
    seen.record_read("one", 5)
    seen.await_replica()
    first = seen.awaited
    seen.record_write({"instance": "one", "seq": 7})
    seen.await_replica()
    assert first is not None and seen.awaited is not None
    seen.caught_up(first)  # a read that began before the write
    assert seen.is_behind
    seen.caught_up(seen.awaited)
    assert not seen.is_behind
    assert reported == [True, True, False]
    seen.record_read("one", 6)
    assert seen.least == seen.last_receipt == Receipt("one", 7)


def test_reads_near_a_replica_tell_their_reach(near: TransformClient) -> None:
    near.set_transform(StampedTransform("map", "base", 1, Transform()))
    near.lookup_transform("map", "base")
    least, receipt = near._connection.exchange.seen.least, near.last_receipt
    assert least is not None and receipt is not None
    assert (least.instance, least.seq >= receipt.seq) == (receipt.instance, True)
