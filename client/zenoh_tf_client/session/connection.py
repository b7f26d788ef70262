"""The connection of a client with the server of one tree: an exchange over a Zenoh session.

It has one Zenoh session, at one of its endpoints (`link`). With several endpoints, `reconnect`
replaces it by one at another endpoint when the tree is not there any more.

Thread safety: all methods; calls of different threads run side by side.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Sequence
from typing import Protocol

import zenoh

from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import NO_CREDENTIALS, Credentials
from zenoh_tf._zenoh.calls import SessionCalls, is_forked
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable

from .exchange import Exchange
from .links import reconnect
from .links.choice import Links
from .links.link import Link
from .server_info import ServerInfo

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
DEFAULT_TREE = "main"
DEFAULT_TIMEOUT_S = 5.0


class ConnectionUser(Protocol):
    """What has declared something in the session, such as a publisher."""

    def connection_changed(self) -> None:
        """Called when the connection has another session: declare it there. Must not raise."""


class Connection(Exchange):
    """A connection with one server; see the module. Close it with `close`."""

    def __init__(
        self,
        endpoint: str | Sequence[str],
        tree: str,
        timeout_s: float,
        credentials: Credentials = NO_CREDENTIALS,
    ) -> None:
        """Connect to the server of `tree` at `endpoint`, or at the first of several where it
        answers.

        Raises:
            ServerUnavailable: No server answered within `timeout_s`.
            AccessDenied: The server does not let this client in, or cannot be trusted.
            InvalidArgumentException: `endpoint` or `timeout_s` is invalid.
        """
        if not 0 < timeout_s < 1e6:
            raise InvalidArgumentException(
                f"timeout_s must be positive, not {timeout_s!r}", field="timeout_s"
            )
        #: All that it may connect to, in this order.
        self.endpoints = zenoh_config.endpoints_of(endpoint)
        for each in self.endpoints:
            zenoh_config.check_encrypted(each, credentials)
        address = zenoh_config.addresses(self.endpoints)
        moves = len(self.endpoints) > 1
        super().__init__(tree, address, credentials.user, timeout_s, moves=moves)
        self._users: weakref.WeakSet[ConnectionUser] = weakref.WeakSet()
        self._moving = threading.Lock()  # of the change of the link, and the end
        self._links = Links(self.endpoints, tree, timeout_s, credentials, self)
        self._use(self._links.first())
        try:
            if self.access is not None:
                self.access.check_any()
            if self.moves:
                reconnect.start(self, self._is_closed)
        except BaseException:
            self.close()
            raise

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session, which may be another one at any time: be in `users`."""
        return self.link.session

    @property
    def calls(self) -> SessionCalls:
        """To be entered around each call into the session."""
        return self.link.calls

    @property
    def endpoint(self) -> str:
        """The endpoint that the session is, or was last, connected to."""
        return self.link.endpoint

    @property
    def instance(self) -> str:
        """Instance id of the server that answered last; asks for it if none is known."""
        return self.known_instance or self.hello().instance

    @property
    def known_instance(self) -> str | None:
        """The same without asking: None if no server is known."""
        server = self.server
        return None if server is None else server.instance

    def close(self) -> None:
        """Close the session; calls of other threads fail soon. May be called again."""
        if is_forked():
            return
        with self._moving:
            self._is_closed.set()
        self.link.close()

    def add_user(self, user: ConnectionUser) -> None:
        """Let a user, unless it is collected, declare again in each later session what it has
        declared in this one."""
        self._users.add(user)

    def check_publish(self, authority: str) -> None:
        """Raise AccessDenied if this client may not publish as `authority`, and what
        `check_writable` raises."""
        if self.access is not None:
            self.access.check_publish(authority)
        self.check_writable()

    def check_writable(self) -> None:
        """Raise the error of `ServerInfo.raise_read_only` if the server is known to accept no
        writes."""
        server = self.server
        if server is not None and server.primary is not None:
            server.raise_read_only()

    def hello(self, timeout_s: float | None = None) -> ServerInfo:
        """Ask the server who it is; as `Exchange.greet`."""
        return self.run(self.greet(timeout_s))

    # --- the link

    def move_if_lost(self) -> bool:
        """As `reconnect.Movable.move_if_lost`."""
        if not self.link.is_lost():
            return True
        link = self._links.another()
        if link is None:
            return False
        with self._moving:
            if self.closed:
                link.close()
                return True
            lost = self.link
            self._use(link)
        reconnect.log.info("connected to %s", zenoh_config.address(link.endpoint))
        for user in list(self._users):
            user.connection_changed()
        lost.close()  # what is under way there ends, and is asked again
        return True

    def router(self) -> str | None:
        link = self.link
        try:
            return link.router()
        except ServerUnavailable:
            if not self.was_replaced(link.queries):
                raise
            return None

    def _use(self, link: Link) -> None:
        self.link, self.queries = link, link.queries
