"""Requests through the server's socket: what goes there, faults of either side, and bounds."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import zenoh

from tests.conftest import StartServer, linux
from tests.processes import forks
from tests.processes.ports import free_endpoint
from tests.processes.servers import START_TIMEOUT_S, ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform, wire
from zenoh_tf._net import handover, keys
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.handover import MAX_REQUEST_BYTES, REQUEST
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable, TransformException
from zenoh_tf_client import TransformClient
from zenoh_tf_client.session.connection import Connection
from zenoh_tf_client.session.local_requests import LocalRequests
from zenoh_tf_client.session.server_info import ServerInfo

pytestmark = [linux, pytest.mark.own_server]


def link(child: str = "base", stamp_ns: int = 1) -> StampedTransform:
    return StampedTransform("map", child, stamp_ns, Transform((1, 2, 3)))


def connect(server: ServerProcess, timeout_s: float = 5.0) -> TransformClient:
    """A client that sends queries through the socket."""
    return TransformClient(Connection(server.endpoint, server.tree, timeout_s), "query")


def through_socket(tf: TransformClient) -> int:
    """How many replies the client has got through the socket."""
    return tf._connection.local.replies


@pytest.fixture
def client(server: ServerProcess) -> Iterator[TransformClient]:
    with connect(server) as tf:
        yield tf


def test_short_reads_and_writes_go_through_the_socket(client: TransformClient) -> None:
    assert client.set_transform(link())
    with client.batch() as batch:
        found = batch.lookup_transform("map", "base")
        batch.set_transform(link("arm"))
    assert found.result() == client.lookup_transform("map", "base") == link()
    with client.transaction() as tx:
        tx.lookup_transform("map", "arm")
        tx.set_transform(link("arm", 2))
    with pytest.raises(InvalidArgumentException):
        client.set_transform(link("map"))
    assert through_socket(client) == 6
    client.frames()
    client.remove_frame("arm")
    assert client.stats()["local_connections"] == 1
    assert through_socket(client) == 6


def test_what_takes_long_goes_over_zenoh(client: TransformClient) -> None:
    client.set_transforms_xact([link(f"frame{index:060}") for index in range(300)])
    before = through_socket(client)
    with pytest.raises(TransformException):
        client.lookup_transform("map", "never", timeout_s=0.05)
    stamps = np.arange(MAX_REQUEST_BYTES // 8)
    client.lookup_transforms("map", f"frame{1:060}", stamps)
    assert through_socket(client) == before
    with client.batch() as batch:  # a short request with a reply of 2 MB
        listed = [batch.frames() for _ in range(100)]
    assert all(len(each.result()) == 301 for each in listed)
    assert through_socket(client) == before
    client.set_transform(link())
    assert through_socket(client) == before + 1  # the connection still serves


def test_an_sdk_client_uses_it_unless_it_asks_by_query(server: ServerProcess) -> None:
    with server.connect(reads="shared") as auto, server.connect(reads="query") as query:
        for tf in (auto, query):
            tf.set_transform(link())
        assert (through_socket(auto), through_socket(query)) == (1, 0)


def test_threads_have_connections_of_their_own(client: TransformClient) -> None:
    threads = 40
    start = threading.Barrier(threads)

    def work(index: int) -> None:
        start.wait()
        for stamp in range(20):
            client.set_transform(link(f"frame{index}", stamp))
            client.lookup_transform("map", f"frame{index}", stamp)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))
    counters = client.stats()
    assert counters["commits"] == threads * 20
    assert 1 < counters["local_connections"] <= 16


def test_the_server_forgets_clients_that_end(server: ServerProcess) -> None:
    script = (
        "import sys, time; from zenoh_tf import *; from zenoh_tf_client import TransformClient\n"
        "tf = TransformClient.connect(sys.argv[1])\n"
        "tf.set_transform(StampedTransform('map', 'base', 1, Transform()))\n"
        "assert tf._connection.local.replies; print('ready', flush=True); time.sleep(600)"
    )
    with server.connect() as watching:
        ended = forks.Popen([sys.executable, "-c", script, server.endpoint], stdout=subprocess.PIPE)
        assert ended.stdout is not None and ended.stdout.readline()
        assert watching.stats()["local_connections"] == 1
        ended.kill()
        ended.wait()
        ended.stdout.close()
        with connect(server) as closed:
            closed.set_transform(link())
        wait_until(lambda: watching.stats()["local_connections"] == 0)


def _sets(tf: TransformClient) -> bool:
    try:
        return tf.set_transform(link())
    except TransformException:
        return False


def test_a_client_goes_on_with_the_next_server(start_sharing: StartServer) -> None:
    endpoint = free_endpoint()
    server = start_sharing(endpoint=endpoint)
    with connect(server) as tf:
        tf.set_transform(link())
        for end in (ServerProcess.kill, ServerProcess.stop):
            end(server)
            server = start_sharing(endpoint=endpoint)
            before = through_socket(tf)
            wait_until(lambda: _sets(tf))
            tf.set_transform(link())
            assert tf.lookup_transform("map", "base") == link()
            assert through_socket(tf) > before
            assert tf.stats()["commits"] == 2


def test_a_write_is_applied_once_if_the_connection_fails(
    server: ServerProcess, client: TransformClient
) -> None:
    """The server gets the request, and the client loses the connection before the reply."""
    client.set_transform(link("first"))
    [peer] = client._connection.local._idle
    server.freeze()
    with ThreadPoolExecutor() as pool:
        write = pool.submit(client.set_transform, link())
        wait_until(lambda: not client._connection.local._idle)
        time.sleep(0.1)  # so that the request is on its way, though it does not matter
        peer._socket.shutdown(socket.SHUT_RD)
        wait_until(lambda: not client._connection.local._peers)
        server.send_signal(signal.SIGCONT)
        assert write.result() is True
    assert through_socket(client) == 1
    wait_until(lambda: client.stats()["local_connections"] == 0)
    assert client.stats()["commits"] == 2


@pytest.mark.parametrize("shared_instance", [True, False])
def test_what_another_server_says_of_a_lost_write_counts_for_nothing(
    socket_folder: Path, shared_instance: bool
) -> None:
    """The server dies after it has got the write, and its successor answers the repeat."""
    instance = "one" if shared_instance else "two"
    answer = wire.pack({"v": 1, "instance": instance, "stored": b"\1"})

    class OverZenoh(Queries):
        def __init__(self) -> None:
            self._server = "the server"

        def ask(
            self,
            key: zenoh.KeyExpr,
            payload: bytes,
            timeout_s: float,
            token: zenoh.CancellationToken | None = None,
        ) -> bytes:
            return answer

    path = str(socket_folder / "main.sock")
    with socket.socket(socket.AF_UNIX) as listener, ThreadPoolExecutor() as pool:
        listener.bind(path)
        listener.listen()

        def die() -> None:
            peer, _ = listener.accept()
            with peer, open(os.devnull) as anything:
                greeting = handover.message("main", "one", {})
                socket.send_fds(peer, [greeting], [anything.fileno()])
                peer.recv(REQUEST.size + 2 + REQUEST.size + 5, socket.MSG_WAITALL)

        dying = pool.submit(die)
        offer = handover.Offer(handover.boot_id(), path, requests=True)
        server = ServerInfo("one", 0, 0, message_bytes=1000, rows=1000, offer=offer)
        local = LocalRequests(OverZenoh(), "main", "me")
        key = zenoh.KeyExpr(keys.request("main", "commit"))
        reply = local.ask(server, key, b"write", 5.0)
        dying.result()
        assert (reply == answer) is shared_instance
        assert isinstance(reply, NoReply) is not shared_instance
        local.close()


def test_closing_ends_calls(server: ServerProcess) -> None:
    with connect(server, 60.0) as tf, ThreadPoolExecutor() as pool:
        tf.set_transform(link())
        server.freeze()
        call = pool.submit(tf.lookup_transform, "map", "base")
        wait_until(lambda: not tf._connection.local._idle)
        tf.close()
        with pytest.raises(ServerUnavailable, match="closed"):
            call.result(START_TIMEOUT_S)
        server.send_signal(signal.SIGCONT)
    with pytest.raises(ServerUnavailable, match="closed"):
        tf.set_transform(link())


def test_a_server_with_users_takes_no_requests(start_sharing: StartServer, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.touch(0o600)
    users.write_text("ann:secret\n")
    server = start_sharing("--users", str(users))
    ann = Credentials(user="ann", password="secret")
    connection = Connection(server.endpoint, server.tree, 5.0, ann)
    with TransformClient(connection, "query") as tf:
        tf.set_transform(link())
        assert through_socket(tf) == 0
        offer = connection.hello().offer
        assert offer is not None and not offer.requests
        with handover.connect(offer, server.tree, tf.instance, 5.0) as peer:
            assert peer.recv(1) == b""


def test_a_forked_child_does_not_use_its_parents_connection(client: TransformClient) -> None:
    client.set_transform(link())
    [peer] = client._connection.local._idle
    child = os.fork()
    if child == 0:
        try:
            client.set_transform(link())
        except ServerUnavailable as error:
            client.close()
            os._exit(7 if "forked" in str(error) else 1)
        finally:
            os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    client.set_transform(link())
    assert client._connection.local._idle == [peer]
    assert through_socket(client) == 2
