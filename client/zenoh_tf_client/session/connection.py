"""The connection of a client with the server of one tree: sends requests, and reports missing
replies.

It has one Zenoh session, at one of its endpoints (`link`). With several endpoints, `reconnect`
replaces it by one at another endpoint when the tree is not there any more.

Thread safety: all methods; calls of different threads run side by side.
"""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Sequence
from typing import Protocol, TypeVar

import zenoh

from zenoh_tf import threads
from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import NO_CREDENTIALS, Credentials
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf._zenoh.calls import SessionCalls, is_forked
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable

from ..requests.receipt import Receipt
from ..requests.request import Request
from .exchange import Exchange
from .links import reconnect
from .links.choice import Links
from .links.link import Link
from .server_info import ServerInfo
from .steps import Ask, Pause, ReadQuery, Steps, decode

T = TypeVar("T")

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
DEFAULT_TREE = "main"
DEFAULT_TIMEOUT_S = 5.0


class ConnectionUser(Protocol):
    """What has declared something in the session, such as a publisher."""

    def connection_changed(self) -> None:
        """Called when the connection has another session: declare it there. Must not raise."""


class Connection:
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
        self._address = zenoh_config.addresses(self.endpoints)  # for messages: without secrets
        self.tree = tree
        self.timeout_s = timeout_s
        self.exchange = Exchange(
            tree, self._address, credentials.user, timeout_s, moves=len(self.endpoints) > 1
        )
        self._users: weakref.WeakSet[ConnectionUser] = weakref.WeakSet()
        self._is_closed = threading.Event()
        self._moving = threading.Lock()  # of the change of the link, and the end
        self._links = Links(self.endpoints, tree, timeout_s, credentials, self.exchange)
        self.link = self._links.first()
        self.exchange.router = self._router
        try:
            if self.exchange.access is not None:
                self.exchange.access.check_any()
            if self.exchange.moves:
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
    def queries(self) -> Queries:
        """The queries of the session."""
        return self.link.queries

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
        server = self.known_server
        return None if server is None else server.instance

    @property
    def known_server(self) -> ServerInfo | None:
        """The server that answered last, without asking: None if none is known."""
        return self.exchange.server

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self._is_closed.is_set()

    def close(self) -> None:
        """Close the session; calls of other threads fail soon. May be called again."""
        if is_forked():
            return
        with self._moving:
            self._is_closed.set()
        self.link.close()

    @property
    def last_receipt(self) -> Receipt | None:
        """Of the latest write that the server has replied to; None if there was none."""
        return self.exchange.last_receipt

    def add_user(self, user: ConnectionUser) -> None:
        """Let a user, unless it is collected, declare again in each later session what it has
        declared in this one."""
        self._users.add(user)

    def check_publish(self, authority: str) -> None:
        """Raise AccessDenied if this client may not publish as `authority`, and what
        `check_writable` raises."""
        if self.exchange.access is not None:
            self.exchange.access.check_publish(authority)
        self.check_writable()

    def check_writable(self) -> None:
        """Raise the error of `ServerInfo.raise_read_only` if the server is known to accept no
        writes."""
        server = self.exchange.server
        if server is not None and server.primary is not None:
            server.raise_read_only()

    def hello(self, timeout_s: float | None = None) -> ServerInfo:
        """Ask the server who it is; as `Exchange.hello`."""
        return self._run(self.exchange.hello(timeout_s))

    def call(self, request: Request[T]) -> T:
        """Send a request and return its result; as `Exchange.call`, with a fast path beside it."""
        exchange = self.exchange
        server = exchange.server
        if server is None or request.writes or exchange.moves or exchange.access is not None:
            return self._run(exchange.call(request))
        # The common case is a query and its reply. The steps of an exchange would add a half to
        # the client's own work for a lookup, so they begin where that is not enough.
        key, payload = exchange.keys[request.request_type], server.check_size(request.payload())
        timeout_s = self.timeout_s + request.wait_s
        begin_s = time.monotonic()
        reply = self.link.queries.ask(key, payload, timeout_s)
        if type(reply) is bytes and begin_s < exchange.next_hello_s:
            result = request.parse_plain(reply, server.instance)
            if result is not None:
                exchange.age_s = None
                return result[0]
            if exchange.is_served(message := decode(reply)):
                exchange.take_age(message)
                return request.parse(message)
        query = ReadQuery(key, payload, timeout_s, begin_s + timeout_s)
        return self._run(exchange.finish_read(request, query, reply))

    def _run(self, steps: Steps[T]) -> T:
        """Run the steps one after another, and return their result."""
        return threads.run_steps(steps, self._take)

    def _take(self, step: Ask | Pause) -> bytes | NoReply | None:
        if isinstance(step, Pause):
            time.sleep(step.seconds)
            return None
        link = self.link
        try:
            return link.queries.ask(step.key, step.payload, step.timeout_s)
        except ServerUnavailable:
            if not self.was_replaced(link):
                raise
            return link.queries.went_away()

    # --- the link

    def was_replaced(self, link: Link) -> bool:
        """Whether a call failed because the connection has another link by now."""
        return link is not self.link and not self.closed

    def move_if_lost(self) -> bool:
        """As `reconnect.Movable.move_if_lost`."""
        if not self.link.is_lost():
            return True
        link = self._links.another()
        if link is None:
            return False
        with self._moving:
            if self._is_closed.is_set():
                link.close()
                return True
            lost, self.link = self.link, link
        reconnect.log.info("connected to %s", zenoh_config.address(link.endpoint))
        for user in list(self._users):
            user.connection_changed()
        lost.close()  # what is under way there ends, and is asked again
        return True

    def _router(self) -> str | None:
        """The id of the router that the session has a link to; None if it has none now."""
        link = self.link
        try:
            return link.router()
        except ServerUnavailable:
            if not self.was_replaced(link):
                raise
            return None
