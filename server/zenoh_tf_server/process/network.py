"""The Zenoh session of a server: an embedded router, or a client of an existing network."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Final

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._zenoh import connect_failure
from zenoh_tf.errors import AccessDenied

from ..limits import Limits
from ..security.settings import OPEN, Security

#: How long a server waits for the router that it joins, which may be starting beside it.
CONNECT_TIMEOUT_S: Final = 10.0
RETRY: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
#: Messages of up to this many times the limit are received, so that the server can refuse them
#: with a reply. Zenoh closes the connection of a client that sends a larger one.
RECEIVE_MARGIN: Final = 4
#: Between two attempts at several routers.
_PAUSE_S: Final = 0.1


class NetworkError(Exception):
    """The session cannot be opened; the message is one line for the user."""


def open_session(
    listen: Sequence[str],
    connect: Sequence[str],
    limits: Limits,
    security: Security = OPEN,
    tree: str = "main",
    *,
    gossip: bool = False,
) -> zenoh.Session:
    """Open a session: a client of `connect` if that is not empty, else a router on `listen`.

    `security` says who may use the router, and `tree` for which keys. `gossip`: the router
    introduces peers to each other, which ROS 2 nodes rely on.

    Raises:
        NetworkError: The endpoints cannot be reached or listened on.
    """
    # The stream of changes is of this priority: a burst must not be dropped at once.
    queue = "transport/link/tx/queue/size/data_low"
    if not connect:
        settings = security.router_settings(tree) | {queue: 16, "scouting/gossip/enabled": gossip}
        return open_router(listen, limits, limits.message_bytes, settings)
    try:
        config = zenoh_config.client(
            connect,
            CONNECT_TIMEOUT_S,
            retry=RETRY,
            max_message_bytes=RECEIVE_MARGIN * max(limits.message_bytes, wire.MAX_REPLY_BYTES),
            credentials=security.credentials,
            lease_ms=zenoh_config.SERVER_LEASE_MS,
        )
        config.insert_json5(queue, "16")
        return _open(config, connect)
    except zenoh.ZError as error:
        failure = connect_failure.explain_all(
            connect, tree, CONNECT_TIMEOUT_S, security.credentials
        )
        if isinstance(failure, AccessDenied):
            raise NetworkError(f"cannot connect: {failure}") from error
        where = ", ".join(map(zenoh_config.address, connect))
        raise NetworkError(
            f"cannot connect to {where} within {CONNECT_TIMEOUT_S:g} s: is a router there?"
        ) from error


def open_router(
    listen: Sequence[str], limits: Limits, max_bytes: int, settings: Mapping[str, object]
) -> zenoh.Session:
    """Open a router with further settings, which receives messages of up to `max_bytes`, and larger
    ones to refuse them.

    Raises:
        NetworkError: The endpoints cannot be listened on.
    """
    try:
        return zenoh.open(
            zenoh_config.router(
                listen,
                max_sessions=limits.connections,
                max_message_bytes=RECEIVE_MARGIN * max_bytes,
                security=settings,
            )
        )
    except zenoh.ZError as error:
        where = ", ".join(map(zenoh_config.address, listen))
        reason = str(error).split(" at /", maxsplit=1)[0]  # without the path into its sources
        if "Address already in use" in reason:
            reason = "the port is already in use"
        raise NetworkError(f"cannot listen on {where}: {reason}") from error


def _open(config: zenoh.Config, connect: Sequence[str]) -> zenoh.Session:
    """Open a session. Zenoh itself waits for a router that is starting only if there is one."""
    deadline_s = time.monotonic() + CONNECT_TIMEOUT_S
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if len(connect) < 2 or time.monotonic() >= deadline_s:
                raise
        time.sleep(_PAUSE_S)


def open_client_session(
    endpoint: str, timeout_s: float, limits: Limits, credentials: Credentials
) -> zenoh.Session:
    """Join the network of another server. The session connects again by itself when it has lost it.

    Raises:
        zenoh.ZError: Nobody answered within `timeout_s`.
    """
    max_bytes = RECEIVE_MARGIN * max(limits.message_bytes, wire.MAX_REPLY_BYTES)
    return zenoh.open(
        zenoh_config.client(
            [endpoint],
            timeout_s,
            retry=RETRY,
            max_message_bytes=max_bytes,
            credentials=credentials,
        )
    )


def certificate_of(session: zenoh.Session, client: str) -> str | None:
    """The common name of a client's certificate, by its Zenoh id; None if it has shown none."""
    for link in session.info.links():
        if str(link.zid) == client:
            return link.auth_identifier
    return None


def addresses(session: zenoh.Session) -> dict[str, str]:
    """The address at the other end of each link, such as ``tcp/10.0.0.7:50312``, by the Zenoh id
    there."""
    return {str(link.zid): link.dst for link in session.info.links()}
