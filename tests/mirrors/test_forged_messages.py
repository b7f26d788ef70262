"""Mirrors whose stream has messages that are not the server's: what they accept, and how long."""

from __future__ import annotations

import logging

import pytest

from tests.conftest import ServerProcess
from tests.support.raw import raw
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import keys
from zenoh_tf.mirrors.source import ServerStatus, State
from zenoh_tf.mirrors.stream_guard import is_ahead, senders
from zenoh_tf_client import TransformClient

from .test_mirroring import Network


def settled() -> Network:
    network = Network(7)
    network.settle()
    return network


def message(network: Network, first: int, last: int, instance: str | None = None) -> bytes:
    server = network.server
    forged = wire.StreamMessage(instance or server.instance, first, last, server.clock_ns)
    return wire.pack(wire.stream_body(forged))


@pytest.mark.parametrize("ahead", [(1, 1 << 62), (1, 1 << 30), (1, 1), (1, 40), (1 << 61, 1 << 61)])
def test_numbers_that_the_server_has_not_sent(ahead: tuple[int, int]) -> None:
    """The copy is made again once the server's own messages say otherwise."""
    network = settled()
    mirroring = network.mirroring
    seq = mirroring.state.seq
    mirroring.received(message(network, seq + ahead[0], seq + ahead[1]))
    network.seen.clear()  # the number has gone forward in error
    for _ in range(30):
        network.server.write()
        mirroring.received(network.server.publish())
        network.under_way += mirroring.take_requests()
        while network.under_way:
            request = network.under_way.pop()
            mirroring.answered(request.number, network.server.reply(request))
    assert mirroring.contradictions == 1
    assert mirroring.snapshots == 2
    network.settle()


def test_replies_of_another_instance_are_not_taken() -> None:
    network = settled()
    mirroring = network.mirroring
    mirroring.restart()
    (plan,) = mirroring.take_requests()
    mirroring.answered(plan.number, network.server.reply(plan))
    request = mirroring.take_requests()[0]
    mirroring.answered(request.number, network.server.reply(request) | {"instance": "other"})
    assert mirroring.snapshots == 2
    network.settle()


@pytest.mark.parametrize(
    ("key", "instance"),
    [
        ("tf/v1/main/stream/abc", "abc"),
        ("tf/v1/main/stream/*", None),
        ("tf/v1/main/**", None),
        ("**", None),
        ("tf/v1/*/stream/abc", None),
        ("tf/v1/main/stream/abc/x", None),
        ("tf/v1/other/stream/abc", None),
    ],
)
def test_only_the_stream_s_own_key_names_an_instance(key: str, instance: str | None) -> None:
    sender = senders("main", "")
    for _ in range(2):
        assert sender(key) == instance


def test_a_state_ahead_of_its_server() -> None:
    server = ServerStatus("i", 100, 10)
    assert not is_ahead(State(None, "i", 10, 100), server)
    assert is_ahead(State(None, "i", 11, 100), server)
    assert is_ahead(State(None, "i", 10, 101), server)
    assert not is_ahead(State(None, "of another", 11, 101), server)
    assert not is_ahead(State(None, "i", 11, 100), ServerStatus("i", 100, None))


@pytest.mark.own_server
def test_a_mirror_recovers_from_forged_messages(
    server: ServerProcess, client: TransformClient, caplog: pytest.LogCaptureFixture
) -> None:
    """Without users anyone may put on the stream: the mirror finds out, and says so."""
    with raw(server.endpoint) as attacker, client.mirror() as m:
        client.set_transform(StampedTransform("map", "base", 1, Transform()))
        m.wait_for()
        key = keys.stream("main", m.instance)
        with caplog.at_level(logging.ERROR, "zenoh_tf.mirror"):
            for wild in ("tf/v1/main/stream/*", "tf/v1/main/**", "**", key):
                forged = wire.StreamMessage(m.instance, m.seq + 1, m.seq + 500, 1 << 62)
                attacker.session.put(wild, wire.pack(wire.stream_body(forged)))

            def is_right() -> bool:
                client.set_transform(StampedTransform("map", "base", 2, Transform((2, 0, 0))))
                return bool(caplog.records) and m.synced and m.seq < 400

            wait_until(is_right, "the mirror has the forged number")
        assert "contradicts its server" in caplog.text
        m.wait_for()
        assert m.lookup_transform("map", "base").transform.translation[0] == 2
        assert m.age_s < 60
