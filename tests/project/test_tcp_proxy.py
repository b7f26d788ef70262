"""The TCP proxy does what the chaos tests rely on."""

from __future__ import annotations

import contextlib
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from tests.processes.tcp_proxy import TcpProxy


class _Echo(socketserver.BaseRequestHandler):
    """Sends back what it gets."""

    def handle(self) -> None:
        with contextlib.suppress(OSError):
            while data := self.request.recv(1 << 16):
                self.request.sendall(data)


@contextmanager
def _connected() -> Iterator[tuple[TcpProxy, socket.socket]]:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Echo) as server:
        threading.Thread(target=server.serve_forever).start()
        with (
            TcpProxy(f"tcp/127.0.0.1:{server.server_address[1]}") as proxy,
            socket.create_connection(_address(proxy), timeout=10) as connection,
        ):
            connection.sendall(b"a")
            assert connection.recv(1) == b"a"
            yield proxy, connection
        server.shutdown()


def _address(proxy: TcpProxy) -> tuple[str, int]:
    return "127.0.0.1", int(proxy.endpoint.rpartition(":")[2])


@pytest.mark.parametrize(
    "slow",
    [TcpProxy.hold, lambda proxy: proxy.delay(0.4), lambda proxy: proxy.throttle(10_000)],
    ids=["hold", "delay", "throttle"],
)
def test_what_is_slow_arrives_late(slow: Callable[[TcpProxy], None]) -> None:
    with _connected() as (proxy, connection):
        slow(proxy)
        time.sleep(0.1)
        connection.sendall(b"x" * 4000)
        connection.settimeout(0.2)
        with pytest.raises(TimeoutError):
            connection.recv(4000)
        proxy.release()
        connection.settimeout(10)
        got = 0
        while got < 4000:
            got += len(connection.recv(4000))
