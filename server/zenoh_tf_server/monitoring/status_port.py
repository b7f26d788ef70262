"""A small HTTP server for Prometheus and health checks, apart from the service's own port.

Each connection has a thread, for one request; there are few, and none stays for long, so that no
client of this port can use up the server's threads. If there are too many, the oldest one ends: a
health check is answered within milliseconds, so those that stay are of others.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

from zenoh_tf import threads

from ..process.network import NetworkError

#: Connections that are served at once.
_MAX_CONNECTIONS: Final = 16
#: How long a connection may last, however much it sends meanwhile.
_TIMEOUT_S: Final = 5.0
#: What a host without one of its families answers.
_NO_SUCH_ADDRESS: Final = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)

log = logging.getLogger("zenoh_tf.server.status")


@dataclass(frozen=True, slots=True)
class Page:
    status: int
    body: bytes
    content_type: str = "text/plain; charset=utf-8"


Pages = Mapping[str, Callable[[], Page]]


class StatusPort:
    """Serves pages by path from construction to the process's end."""

    def __init__(self, address: tuple[str, int], pages: Pages) -> None:
        """Listen on all addresses of a host.

        Raises:
            NetworkError: The host and port cannot be listened on.
        """
        host, port = address
        try:
            self._servers = _listen(host, port, pages)
        except OSError as error:
            raise NetworkError(
                f"cannot serve metrics on {host}:{port}: {error.strerror or error}"
            ) from error
        for server in self._servers:
            threads.start("status", server.serve_forever)

    @property
    def port(self) -> int:
        """The port listened on; the system has chosen it if 0 was asked for."""
        return self._servers[0].server_port


def _listen(host: str, port: int, pages: Pages) -> list[_HttpServer]:
    """A server for each address of a host, such as those of both families of localhost."""
    servers: list[_HttpServer] = []
    missing: OSError | None = None
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    addresses = dict.fromkeys((family, where[0]) for family, *_, where in found)
    for family, address in addresses:
        try:
            only = len(addresses) > 1
            servers.append(_HttpServer((address, port), family, pages, only_family=only))
        except OSError as error:
            if error.errno not in _NO_SUCH_ADDRESS:
                raise
            missing = error
        else:
            port = servers[0].server_port
    if not servers and missing is not None:
        raise missing
    return servers


class _HttpServer(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(
        self, where: Any, family: socket.AddressFamily, pages: Pages, *, only_family: bool
    ) -> None:
        self.address_family = family
        self._only_family = only_family
        self.pages = pages
        self._lock = threading.Lock()
        self._begun_s: dict[socket.socket, float] = {}  # of the open connections, oldest first
        super().__init__(where, _Handler)

    def server_bind(self) -> None:
        """As the base class of the base class: that one asks DNS for the host's name."""
        if self._only_family and self.address_family == socket.AF_INET6:  # another has IPv4
            self.socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = "", int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            if len(self._begun_s) >= _MAX_CONNECTIONS:
                self._end(next(iter(self._begun_s)))
            self._begun_s[request] = time.monotonic()
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            with self._lock:
                self._begun_s.pop(request, None)

    def service_actions(self) -> None:
        """Called all the time: end the connections that have lasted for too long."""
        latest_s = time.monotonic() - _TIMEOUT_S
        with self._lock:
            for connection in [each for each, begun in self._begun_s.items() if begun < latest_s]:
                self._end(connection)

    def _end(self, connection: socket.socket) -> None:
        """Requires the lock. Its thread closes the connection."""
        del self._begun_s[connection]
        with contextlib.suppress(OSError):  # it has ended
            connection.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("a request for a page failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    timeout = _TIMEOUT_S  # of one read
    server_version = "zenoh-tf"
    sys_version = ""
    server: _HttpServer

    def do_GET(self) -> None:
        self._send(with_body=True)

    def do_HEAD(self) -> None:
        self._send(with_body=False)

    def _send(self, with_body: bool) -> None:
        make = self.server.pages.get(self.path.partition("?")[0])
        page = make() if make else Page(404, b"pages: /metrics, /healthz, /readyz\n")
        self.send_response(page.status)
        self.send_header("Content-Type", page.content_type)
        self.send_header("Content-Length", str(len(page.body)))
        self.end_headers()
        if with_body:
            self.wfile.write(page.body)

    def log_message(self, form: str, *args: Any) -> None:
        log.debug("%s: %s", self.address_string(), form % args)
