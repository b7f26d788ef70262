"""Reads of one client never go back: it says what it has seen, and servers say what they showed."""

from __future__ import annotations

from tests.conftest import ServerProcess
from tests.support.raw import raw
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf_client import TransformClient
from zenoh_tf_client.requests.receipt import Receipt
from zenoh_tf_client.session.seen_states import SeenStates


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
