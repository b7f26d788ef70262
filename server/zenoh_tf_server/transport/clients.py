"""The clients that are connected, by their liveliness tokens.

A query says which client sent it, but anyone may say anything: only an id with a live token is
regarded as a client of its own. All other queries belong to the client "". So do, for some
milliseconds, those of a new client whose token arrives after its first query. Its link is known
earlier, but cannot stand in for the token: clients behind a router have no link of their own, and
what is kept for a client would need a second rule for when to forget it if its token never comes.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import logging
import secrets
import threading
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zenoh_tf._net import keys
from zenoh_tf.bounded_map import BoundedMap
from zenoh_tf.errors import InvalidArgumentException

from ..requests.handler import UNKNOWN

log = logging.getLogger("zenoh_tf.server")

#: As many clients that are gone are remembered. Their links close within seconds.
_MAX_GONE: Final = 4096


class Clients:
    """The ids of the clients that are connected."""

    def __init__(self, max_clients: int) -> None:
        #: The id in the queries of this server to itself. Nobody else knows it.
        self.own = secrets.token_hex(16)
        self._max_clients = max_clients
        self._lock = threading.Lock()
        #: Changed under the lock, read without.
        self.connected: set[str] = set()
        self._gone = BoundedMap[str, None](_MAX_GONE)
        self._when_gone: list[Callable[[str], None]] = []
        self._subscriber: zenoh.Subscriber[Any] | None = None

    def start(self, session: zenoh.Session, tree: str) -> None:
        """Follow the tokens of a tree's clients."""
        self._subscriber = session.liveliness().declare_subscriber(
            keys.clients(tree), self._changed, history=True
        )

    def close(self) -> None:
        """Follow no more tokens."""
        if self._subscriber is not None:
            self._subscriber.undeclare()

    def known(self, client: str) -> str:
        """The client's id if it is connected, or this server itself, else UNKNOWN."""
        return client if client in self.connected or client == self.own else UNKNOWN

    def is_connected(self, client: str) -> bool:
        """True if the client's token is there, or for this server itself."""
        return self.known(client) != UNKNOWN

    def has_been_known(self, client: str) -> bool:
        """True if the client is or was connected, though its link may still be there."""
        return client in self.connected or client in self._gone

    def when_gone(self, callback: Callable[[str], None]) -> None:
        """Call `callback` with the id of each client that goes, on a thread of Zenoh."""
        self._when_gone.append(callback)

    def __len__(self) -> int:
        return len(self.connected)

    def _changed(self, token: zenoh.Sample) -> None:
        with contextlib.suppress(InvalidArgumentException):  # not an id that a client would have
            client = keys.last_name(str(token.key_expr))
            if token.kind == zenoh.SampleKind.PUT:
                self._add(client)
            else:
                self._remove(client)

    def _add(self, client: str) -> None:
        with self._lock:
            if len(self.connected) < self._max_clients:
                self.connected.add(client)
                log.debug("client %s is connected", client, extra={"client": client})

    def _remove(self, client: str) -> None:
        with self._lock:
            if client not in self.connected:
                return
            self._gone[client] = None
            self.connected.remove(client)
        log.debug("client %s is gone", client, extra={"client": client})
        for callback in self._when_gone:
            try:
                callback(client)
            except Exception:  # the other callbacks must be called
                log.exception("internal error after client %s has gone", client)
