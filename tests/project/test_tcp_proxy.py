"""The TCP proxy does what the chaos tests rely on."""

from __future__ import annotations

import contextlib
import gc
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.processes.tcp_proxy import TcpProxy


@contextmanager
def _echo() -> Iterator[str]:
    """A server that sends back what it gets."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve(peer: socket.socket) -> None:
            with peer:
                try:
                    while data := peer.recv(1 << 16):
                        peer.sendall(data)
                except OSError:
                    pass

        def accept() -> None:
            while True:
                try:
                    peer, _ = server.accept()
                except OSError:
                    return
                threading.Thread(target=serve, args=(peer,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)


@contextmanager
def _connected() -> Iterator[tuple[TcpProxy, socket.socket]]:
    with _echo() as target, TcpProxy(target) as proxy:
        port = int(proxy.endpoint.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
            connection.sendall(b"a")
            assert connection.recv(1) == b"a"
            yield proxy, connection


def test_it_forwards_large_messages() -> None:
    with _connected() as (_, connection):
        data = b"x" * 300_000
        threading.Thread(target=connection.sendall, args=(data,)).start()
        got = 0
        while got < len(data):
            got += len(connection.recv(1 << 16))


def test_what_is_held_arrives_after_the_release() -> None:
    with _connected() as (proxy, connection):
        proxy.hold()
        time.sleep(0.1)
        connection.sendall(b"late")
        connection.settimeout(0.3)
        with pytest.raises(TimeoutError):
            connection.recv(4)
        proxy.release()
        connection.settimeout(10)
        assert connection.recv(4) == b"late"


def test_a_delay_delays() -> None:
    with _connected() as (proxy, connection):
        proxy.delay(0.4)
        time.sleep(0.1)
        connection.sendall(b"x")
        connection.settimeout(0.2)
        with pytest.raises(TimeoutError):
            connection.recv(1)
        connection.settimeout(10)
        assert connection.recv(1) == b"x"


def test_a_throttle_limits_the_rate() -> None:
    with _connected() as (proxy, connection):
        proxy.throttle(10_000)
        time.sleep(0.1)
        connection.sendall(b"x" * 4000)
        connection.settimeout(0.2)
        with pytest.raises(TimeoutError):
            connection.recv(4000)
        connection.settimeout(10)
        got = 0
        while got < 4000:
            got += len(connection.recv(4000))


def test_a_cut_ends_the_connection() -> None:
    with _connected() as (proxy, connection):
        proxy.cut()
        assert connection.recv(1) == b""


def test_a_reset_is_an_error() -> None:
    with _connected() as (proxy, connection):
        proxy.reset()
        with pytest.raises(ConnectionResetError):
            connection.recv(1)


def test_a_connection_to_nothing_ends() -> None:
    with TcpProxy("tcp/127.0.0.1:9") as proxy:
        port = int(proxy.endpoint.rpartition(":")[2])
        address = ("127.0.0.1", port)
        with (
            socket.create_connection(address, timeout=10) as connection,
            contextlib.suppress(ConnectionResetError),
        ):
            assert connection.recv(1) == b""


@pytest.mark.slow
def test_a_proxy_closes_while_connections_begin() -> None:
    with socket.create_server(("127.0.0.1", 0)) as target:
        for _ in range(20):
            with contextlib.ExitStack() as opened:
                with TcpProxy(f"tcp/127.0.0.1:{target.getsockname()[1]}") as proxy:
                    port = int(proxy.endpoint.rpartition(":")[2])
                    for _ in range(5):
                        connection = socket.create_connection(("127.0.0.1", port), timeout=10)
                        opened.enter_context(connection)
                gc.collect()  # what is left open is reported here
