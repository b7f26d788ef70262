"""Zenoh configurations: every client, server, test and benchmark gets its own from here.

Discovery and shared memory are off in all of them. Shared memory can drop a reply when the
receiver stalls for 100 ms.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import zenoh

from ..errors import InvalidArgumentException
from .credentials import NO_CREDENTIALS, Credentials, zenoh_settings

#: The protocols that Zenoh's Python package can connect and listen with.
PROTOCOLS: Final = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
#: The protocols that encrypt, and that know certificates.
TLS_PROTOCOLS: Final = ("tls", "quic")
#: Protocols whose address is a path, not HOST:PORT.
_PATH_PROTOCOLS: Final = ("unixsock-stream",)
_MAX_PORT: Final = 65535
#: As many endpoints stand in one list: each costs an attempt.
MAX_ENDPOINTS: Final = 16
#: How long a server may be silent until its clients, and routers, close the connection: it is
#: frozen or cut off. It says something four times as often. Zenoh's own 10 s are long to wait.
SERVER_LEASE_MS: Final = 3000
#: Between the endpoints of one text; not a comma of an endpoint's own options.
_SEPARATOR: Final = re.compile(r"\s*,\s*(?=[a-z][a-z-]*/)")

#: Zenoh's `connect/retry`: first pause, longest pause, and their growth.
Retry = Mapping[str, int]

_COMMON: Final[dict[str, Any]] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "scouting/delay": 0,  # there is nothing to wait for
}


def address(endpoint: str) -> str:
    """``PROTOCOL/ADDRESS`` of an endpoint, for messages and logs.

    Leaves out metadata and options (``?...``, ``#...``): with TLS they hold the private key's
    path, or the key itself.
    """
    return endpoint.partition("#")[0].partition("?")[0]


def protocol(endpoint: str) -> str:
    """The protocol of an endpoint, e.g. ``tcp``."""
    return endpoint.partition("/")[0]


def endpoints_of(given: str | Iterable[str]) -> tuple[str, ...]:
    """The endpoints of a list, in its order and each once; commas may separate them in a text.

    Raises:
        InvalidArgumentException: There is none, there are too many, or Zenoh understands one of
            them not; ``field`` is "endpoint".
    """
    texts = [given] if isinstance(given, str) else list(given)
    found = tuple(dict.fromkeys(each for text in texts for each in _SEPARATOR.split(text)))
    if not found:
        raise InvalidArgumentException(
            "no endpoint: name at least one, e.g. tcp/HOST:PORT", field="endpoint"
        )
    if len(found) > MAX_ENDPOINTS:
        raise InvalidArgumentException(
            f"{len(found)} endpoints: the limit is {MAX_ENDPOINTS}",
            field="endpoint",
            limit=MAX_ENDPOINTS,
            value=len(found),
        )
    for endpoint in found:
        check_endpoint(endpoint)
    return found


def addresses(endpoints: Iterable[str]) -> str:
    """The addresses of endpoints, for messages."""
    return " or ".join(map(address, endpoints))


def check_endpoint(endpoint: str) -> None:
    """Check that Zenoh can understand an endpoint.

    Zenoh itself tries an unknown protocol again and again, and names lines of its sources.

    Raises:
        InvalidArgumentException: ``field`` is "endpoint".
    """
    shown = address(endpoint)
    scheme, _, where = shown.partition("/")
    if not where:
        _reject(endpoint, "has no protocol; write it as PROTOCOL/ADDRESS, e.g. tcp/HOST:PORT")
    if scheme not in PROTOCOLS:
        _reject(endpoint, f"has the unknown protocol {scheme!r}; use one of {', '.join(PROTOCOLS)}")
    if scheme in _PATH_PROTOCOLS:
        return
    host, _, port = where.rpartition(":")
    if not host or host.startswith("[") != host.endswith("]"):
        _reject(endpoint, f"must be like {scheme}/HOST:PORT (IPv6: {scheme}/[ADDRESS]:PORT)")
    if not (port.isascii() and port.isdigit() and int(port) <= _MAX_PORT):
        _reject(endpoint, f"has the port {port!r}; use a number from 0 to {_MAX_PORT}")


def check_encrypted(endpoint: str, credentials: Credentials) -> None:
    """Check that credentials for TLS are not for an endpoint without it, which would ignore them.

    Raises:
        InvalidArgumentException: ``field`` is "endpoint".
    """
    if credentials.uses_tls and protocol(endpoint) not in TLS_PROTOCOLS:
        _reject(
            endpoint,
            "is not encrypted, but the credentials have files for TLS: use tls/HOST:PORT, or "
            "leave the files out",
        )


def _reject(endpoint: str, reason: str) -> None:
    raise InvalidArgumentException(f"endpoint {address(endpoint)!r} {reason}", field="endpoint")


def client(
    endpoints: Sequence[str],
    timeout_s: float,
    *,
    retry: Retry | None = None,
    max_message_bytes: int | None = None,
    credentials: Credentials = NO_CREDENTIALS,
    lease_ms: int | None = None,
) -> zenoh.Config:
    """A session that joins the network at the first of `endpoints` that opens one.

    It tries for `timeout_s` seconds. With several endpoints it tries each once, for so long: given
    a time, Zenoh would try the first one until it is over. After a lost connection Zenoh tries all
    of them in this order, also for so long each, until one opens. `lease_ms`: for how long the
    session may be silent; None: for Zenoh's 10 s.

    Raises:
        zenoh.ZError: Zenoh does not accept an endpoint.
    """
    timeout_ms = int(timeout_s * 1000)
    settings: dict[str, Any] = {"mode": "client", "connect/endpoints": list(endpoints)}
    if len(endpoints) == 1:
        settings["connect/timeout_ms"] = timeout_ms
    else:
        settings |= {"connect/timeout_ms": 0, "transport/unicast/open_timeout": timeout_ms}
    settings |= zenoh_settings(credentials)
    if lease_ms is not None:
        settings["transport/link/tx/lease"] = lease_ms
    if retry is not None:
        settings["connect/retry"] = dict(retry)
    return _config(settings, max_message_bytes)


def router(
    endpoints: Sequence[str],
    *,
    max_sessions: int | None = None,
    max_message_bytes: int | None = None,
    security: Mapping[str, object] | None = None,
) -> zenoh.Config:
    """A router that listens on all of `endpoints`, or fails to open.

    `security` are further settings: keys, users and access rules.

    Raises:
        zenoh.ZError: Zenoh does not accept an endpoint.
    """
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": list(endpoints),
        "listen/exit_on_failure": True,
        "transport/link/tx/lease": SERVER_LEASE_MS,
    }
    settings |= security or {}
    if max_sessions is not None:
        settings["transport/unicast/max_sessions"] = max_sessions
    return _config(settings, max_message_bytes)


def _config(settings: dict[str, Any], max_message_bytes: int | None) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in (_COMMON | settings).items():
        config.insert_json5(key, json.dumps(value))
    if max_message_bytes is not None:
        config.insert_json5("transport/link/rx/max_message_size", json.dumps(max_message_bytes))
    return config
