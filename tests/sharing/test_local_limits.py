"""What a client may send to the server's socket, and what it can harm there."""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.conftest import StartServer, linux
from tests.processes.server_costs import lookup
from tests.processes.servers import START_TIMEOUT_S, ServerProcess
from tests.support import messages
from tests.support.waiting import wait_until
from zenoh_tf import wire
from zenoh_tf._net import handover
from zenoh_tf._net.handover import CLIENT, MAX_REQUEST_BYTES, REPLY, REQUEST
from zenoh_tf.errors import ServerBusy
from zenoh_tf_client import TransformClient
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.transport.lanes import QueueShares
from zenoh_tf_server.transport.local_requests import _Turns

from .test_local_requests import connect, link, through_socket

pytestmark = [linux, pytest.mark.own_server]

LOOKUP, COMMIT = b"lookup\0\0", b"commit\0\0"


@pytest.fixture
def client(server: ServerProcess) -> Iterator[TransformClient]:
    with connect(server) as tf:
        yield tf


def offer_of(server: ServerProcess) -> tuple[handover.Offer, str]:
    with connect(server) as tf:
        offer = tf._connection.hello().offer
        assert offer is not None
        return offer, tf.instance


@contextlib.contextmanager
def raw(server: ServerProcess, name: bytes = b"raw") -> Iterator[socket.socket]:
    """A connection that has said who it is, if `name` is not empty."""
    offer, instance = offer_of(server)
    with handover.connect(offer, server.tree, instance, 5.0) as peer:
        peer.settimeout(START_TIMEOUT_S)
        if name:
            peer.sendall(REQUEST.pack(len(name), CLIENT) + name)
        yield peer


def ask(peer: socket.socket, header: bytes, payload: bytes) -> bytes:
    peer.sendall(REQUEST.pack(len(payload), header) + payload)
    (length,) = REPLY.unpack(peer.recv(REPLY.size, socket.MSG_WAITALL))
    return peer.recv(length, socket.MSG_WAITALL) if length else b""


GARBAGE = {
    "no id": (b"", REQUEST.pack(3, LOOKUP) + b"abc"),
    "a long id": (b"", REQUEST.pack(1000, CLIENT) + b"x" * 1000),
    "random bytes": (b"raw", bytes(range(1, 256))),
    "another type": (b"raw", REQUEST.pack(3, b"admin\0\0\0") + b"abc"),
    "a long request": (b"raw", REQUEST.pack(MAX_REQUEST_BYTES + 1, LOOKUP)),
    "two at once": (b"raw", (REQUEST.pack(3, LOOKUP) + b"abc") * 2),
}


@pytest.mark.parametrize("name", GARBAGE)
def test_garbage_ends_the_connection_with_one_line(
    server: ServerProcess, client: TransformClient, name: str
) -> None:
    who, garbage = GARBAGE[name]
    for _ in range(3):
        with raw(server, who) as peer:
            peer.sendall(garbage)
            with contextlib.suppress(ConnectionResetError):
                assert peer.recv(1) == b""
    server.wait_for_log("closed the connection")
    lines = [line for line in server.log.splitlines() if "closed the connection" in line]
    assert len(lines) == 1 and len(lines[0]) < 300
    client.set_transform(link())
    assert through_socket(client) == 1


def test_a_malformed_message_gets_a_typed_error(server: ServerProcess) -> None:
    with raw(server) as peer:
        for header in (LOOKUP, COMMIT):
            reply = wire.unpack(ask(peer, header, b"\xc1garbage"))
            assert wire.decode_error(reply["error"]).field == "message"
        commit = messages.pack(messages.commit(["map", "base"], [0], [1]))
        assert "stored" in wire.unpack(ask(peer, COMMIT, commit))


def test_a_reply_that_comes_later_is_left_to_zenoh(server: ServerProcess) -> None:
    waiting = wire.pack(
        wire.one_read("map", "never", wire.OP_COMMON, wire.NO_STAMP) | {"timeout_ns": 10**9}
    )
    with raw(server) as peer:
        assert ask(peer, LOOKUP, waiting) == b""
        assert "error" in wire.unpack(ask(peer, LOOKUP, b"\xc1"))


def test_half_a_request_holds_up_nobody(server: ServerProcess, client: TransformClient) -> None:
    with raw(server) as peer:
        peer.sendall(REQUEST.pack(100, LOOKUP) + b"half")
        client.set_transform(link())
    assert through_socket(client) == 1
    wait_until(lambda: client.stats()["local_connections"] == 1)
    assert "closed the connection" not in server.log


@pytest.mark.slow
def test_a_client_that_reads_nothing_is_cut_off_alone(
    server: ServerProcess, client: TransformClient
) -> None:
    client.set_transforms_xact([link(f"frame{index}") for index in range(1000)])
    payload = wire.pack(lookup(900, "map", "frame1"))
    operations = [("info", wire.call_body("frames"))] * 70
    long = wire.pack(wire.batch_body(operations))
    assert len(payload) < MAX_REQUEST_BYTES
    with raw(server) as peer, raw(server, b"other") as other:
        peer.sendall(REQUEST.pack(len(long), b"batch\0\0\0") + long)
        wait_until(lambda: len(peer.recv(1, socket.MSG_PEEK)) == 1)
        for _ in range(100):
            client.set_transform(link())
        assert wire.unpack(ask(other, LOOKUP, payload))["status"] == bytes(900)
        server.wait_for_log("has read nothing")
        assert wire.unpack(ask(other, LOOKUP, payload))["status"] == bytes(900)
        (length,) = struct.unpack("<I", peer.recv(4))
        got = 0
        while more := peer.recv(1 << 20):
            got += len(more)
        assert got < length


def test_connections_are_bounded(start_sharing: StartServer) -> None:
    server = start_sharing("--limit", "local_connections=2")
    clients = [connect(server) for _ in range(4)]
    for tf in clients:
        assert tf.set_transform(link())
    assert clients[0].stats()["local_connections"] == 2
    assert sorted(map(through_socket, clients)) == [0, 0, 1, 1]
    for tf in clients:
        tf.close()


def test_one_client_cannot_take_all_connections(server: ServerProcess) -> None:
    offer, instance = offer_of(server)
    with contextlib.ExitStack() as stack:  # a closed one makes room for another
        peers = []
        for _ in range(40):
            peer = stack.enter_context(handover.connect(offer, server.tree, instance, 5.0))
            peer.settimeout(START_TIMEOUT_S)
            peer.sendall(REQUEST.pack(3, CLIENT) + b"raw")
            peers.append(peer)
        refused = 0
        for peer in peers:
            try:
                assert "error" in wire.unpack(ask(peer, LOOKUP, b"\xc1"))
            except (OSError, struct.error):
                refused += 1
    assert refused == 8


def test_waiting_clients_take_turns() -> None:
    turns = _Turns(QueueShares(Limits(client_pending_queries=3)), 1)
    assert turns.queue_if_busy("running", 10) is None
    served: list[str] = []

    def serve(client: str) -> None:
        assert turns.queue_if_busy(client, 10) is None
        served.append(client)
        turns.end()

    with ThreadPoolExecutor(4) as pool:
        for index, client in enumerate(("greedy", "greedy", "greedy", "modest")):
            pool.submit(serve, client)
            wait_until(lambda index=index: _waiting(turns) == index + 1)  # type: ignore[misc]
        assert isinstance(turns.queue_if_busy("greedy", 10), ServerBusy)
        turns.end()
    assert served == ["greedy", "modest", "greedy", "greedy"]
    assert turns.queue_if_busy("next", 10) is None


def _waiting(turns: _Turns) -> int:
    return turns._shares.counters()["pending_queries"]
