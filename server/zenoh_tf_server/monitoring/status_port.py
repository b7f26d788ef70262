"""A small HTTP server for Prometheus and health checks, apart from the service's own port.

Each connection has a thread, for one request; there are few, and none waits for long, so that no
client of this port can use up the server's threads.
"""

from __future__ import annotations

import argparse
import logging
import socket
import socketserver
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

from zenoh_tf import threads
from zenoh_tf.text import quoted

from ..process.network import NetworkError

#: Connections that are served at once; more are closed at once.
_MAX_CONNECTIONS: Final = 16
_TIMEOUT_S: Final = 5.0

log = logging.getLogger("zenoh_tf.server.status")


@dataclass(frozen=True, slots=True)
class Page:
    status: int
    body: bytes
    content_type: str = "text/plain; charset=utf-8"


Pages = Mapping[str, Callable[[], Page]]


def parse_address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT or [IPV6]:PORT: a type for argparse."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not (port.isascii() and port.isdigit() and int(port) < 65536):
        raise argparse.ArgumentTypeError(f"{quoted(text)} is not HOST:PORT, such as 127.0.0.1:9464")
    return host, int(port)


class StatusPort:
    """Serves pages by path from construction to the process's end."""

    def __init__(self, address: tuple[str, int], pages: Pages) -> None:
        """Raises NetworkError if the host and port cannot be listened on."""
        host, port = address
        try:
            family, *_, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self._http = _HttpServer(where[:2], family, pages)
        except OSError as error:
            raise NetworkError(
                f"cannot serve metrics on {host}:{port}: {error.strerror or error}"
            ) from error
        threads.start("status", self._http.serve_forever)

    @property
    def port(self) -> int:
        """The port listened on; the system has chosen it if 0 was asked for."""
        return int(self._http.server_address[1])


class _HttpServer(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, where: Any, family: socket.AddressFamily, pages: Pages) -> None:
        self.address_family = family
        self.pages = pages
        self._free = threading.BoundedSemaphore(_MAX_CONNECTIONS)
        super().__init__(where, _Handler)

    def server_bind(self) -> None:
        """As the base class of the base class: that one asks DNS for the host's name."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = "", int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("a request for a page failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    timeout = _TIMEOUT_S
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
