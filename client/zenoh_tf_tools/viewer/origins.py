"""Lets only the viewer's own page open its WebSocket.

Any page that a browser has open may connect to a port of this machine, and would see the tree. The
browser says in `Origin` which page that is: it must be of the host that it connects to. That host
must not be a name which a stranger can point here (DNS rebinding): an address, this machine's name,
or a name without a dot.
"""

from __future__ import annotations

import contextlib
import http
import ipaddress
import socket
from collections.abc import Awaitable, Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server as web
from websockets.http11 import Request, Response

Process = Callable[[web.ServerConnection, Request], Awaitable[Response | None] | Response | None]


def is_own(origin: str | None, host: str | None) -> bool:
    """Return whether a request comes from the viewer's page, or from no page at all.

    Args:
        origin: Its header `Origin`; None for a program that is no browser.
        host: Its header `Host`.
    """
    if origin is None:
        return True
    try:
        page, name = urlsplit(origin), urlsplit(f"//{host}").hostname
    except ValueError:
        return False
    return page.scheme in ("http", "https") and page.netloc == host and _is_ours(name or "")


def _is_ours(name: str) -> bool:
    if "." not in name or name.endswith(".local") or name == socket.getfqdn().lower():
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@contextlib.contextmanager
def checked() -> Iterator[None]:
    """Servers of WebSockets that are started in this context refuse other pages.

    viser has no option for it.
    """
    serve = web.serve

    def serve_own(*args: Any, process_request: Process | None = None, **options: Any) -> Any:
        def check(
            connection: web.ServerConnection, request: Request
        ) -> Awaitable[Response | None] | Response | None:
            headers = request.headers
            if "Upgrade" in headers and not is_own(headers.get("Origin"), headers.get("Host")):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "another page\n")
            return None if process_request is None else process_request(connection, request)

        return serve(*args, process_request=check, **options)

    web.serve = serve_own  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        web.serve = serve  # type: ignore[misc]
