"""One Zenoh session with the server of one tree: sends requests, and reports missing replies.

Thread safety: all methods; calls of different threads run side by side.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import ClassVar, Final, Protocol, TypeVar

from zenoh_tf import threads
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._net.credentials import NO_CREDENTIALS, Credentials
from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf.errors import InvalidArgumentException, ServerUnavailable

from ..requests.receipt import Receipt
from ..requests.request import Request
from .calls import SessionCalls
from .exchange import Exchange
from .opening import open_session
from .served_trees import no_server_message, served_trees
from .server_info import ServerInfo
from .steps import Ask, Pause, ReadQuery, Steps, decode

T = TypeVar("T")

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
DEFAULT_TREE = "main"
DEFAULT_TIMEOUT_S = 5.0

_HELLO_PERIOD_S: Final = 0.05
#: If other trees are served, the wait for one that is not ends after this time.
_OTHER_TREES_GRACE_S: Final = 1.0
_OTHER_TREES_PERIOD_S: Final = 0.25
_OTHER_TREES_TIMEOUT_S: Final = 0.4


class ConnectionUser(Protocol):
    """What uses the connection without asking, such as a publisher."""

    @property
    def closed(self) -> bool:
        """Whether it has ended."""

    @property
    def heard(self) -> int:
        """A number that grows with what has come."""

    def connection_changed(self) -> None:
        """Called when the session has another connection to the network."""


class Connection:
    """A session with one server; see the module. Close it with `close`."""

    _exchange_type: ClassVar[type[Exchange]] = Exchange
    _queries_type: ClassVar[type[Queries]] = Queries

    def __init__(
        self,
        endpoint: str | Sequence[str],
        tree: str,
        timeout_s: float,
        credentials: Credentials = NO_CREDENTIALS,
    ) -> None:
        """Connect to the server of `tree` at `endpoint`, or at the first of several that answers.

        Raises:
            ServerUnavailable: No server answered within `timeout_s`.
            AccessDenied: The server does not let this client in, or cannot be trusted.
            InvalidArgumentException: `endpoint` or `timeout_s` is invalid.
        """
        if not 0 < timeout_s < 1e6:
            raise InvalidArgumentException(
                f"timeout_s must be positive, not {timeout_s!r}", field="timeout_s"
            )
        #: All that it may connect to; it prefers the first ones.
        self.endpoints = zenoh_config.endpoints_of(endpoint)
        for each in self.endpoints:
            zenoh_config.check_encrypted(each, credentials)
        self._address = zenoh_config.addresses(self.endpoints)  # for messages: without secrets
        self.tree = tree
        self.timeout_s = timeout_s
        self.exchange = self._exchange_type(tree, self._address, credentials.user, timeout_s)
        deadline_s = time.monotonic() + timeout_s
        self.session = open_session(self.endpoints, tree, timeout_s, credentials)
        self.calls = SessionCalls(self.session.close)
        self.calls.add_owner(self)
        # Each query carries the client's id, so that the server can hold clients apart. The token
        # under the same id lets the server see when the client is gone.
        client_id = str(self.session.zid())
        self.exchange.client_id = client_id
        self.exchange.router = self._router
        self.queries = self._queries_type(
            self.session, self.calls, client_id, f"the server of tree {tree!r} at {self._address}"
        )
        try:
            self._token = self.session.liveliness().declare_token(keys.client(tree, client_id))
            self._wait_for_server(deadline_s)
            if self.exchange.access is not None:
                self.exchange.access.check_any()
        except BaseException:
            self.close()
            raise

    def __del__(self) -> None:
        # Zenoh would close the session when it is freed, outside of `calls`.
        if hasattr(self, "calls"):
            self.calls.add_owner(self)  # the garbage collector has cleared that reference
            self.close()

    @property
    def endpoint(self) -> str:
        """The endpoint that the session is, or was last, connected to."""
        return self.endpoints[0]

    @property
    def instance(self) -> str:
        """Instance id of the server that answered last; asks for it if none is known."""
        return self.known_instance or self._run(self.exchange.greet()).instance

    @property
    def known_instance(self) -> str | None:
        """The same without asking: None if no server is known."""
        server = self.known_server
        return None if server is None else server.instance

    @property
    def known_server(self) -> ServerInfo | None:
        """What answers reads, the replica or the server, without asking: None if none is known."""
        replica = self.exchange.replica
        return self.exchange.server if replica is None else replica.server

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self.calls.closed

    def close(self) -> None:
        """Close the session; calls of other threads fail soon. May be called again."""
        self.calls.close()

    @property
    def last_receipt(self) -> Receipt | None:
        """Of the latest write that the server has replied to; None if there was none."""
        return self.exchange.seen.last_receipt

    def watch_connection(self, user: ConnectionUser, silence_s: float) -> None:
        """Check the link when a user has heard nothing for so long, until it is closed or
        collected, if there is another server to continue at."""

    def check_publish(self, authority: str) -> None:
        """Raise AccessDenied if this client may not publish as `authority`."""
        if self.exchange.access is not None:
            self.exchange.access.check_publish(authority)

    def hello(self, timeout_s: float | None = None) -> ServerInfo:
        """Ask the server who it is; as `Exchange.hello`."""
        return self._run(self.exchange.hello(timeout_s))

    def greet(self, timeout_s: float | None = None) -> ServerInfo:
        """Ask what answers reads who it is; as `Exchange.greet`."""
        return self._run(self.exchange.greet(timeout_s))

    def call(self, request: Request[T]) -> T:
        """Send a request and return its result; as `Exchange.call`, with a fast path beside it."""
        exchange = self.exchange
        server = exchange.server
        if (
            server is None
            or request.writes
            or exchange.reads_may_be_old
            or exchange.access is not None
        ):
            return self._run(exchange.call(request))
        # The common case is a query and its reply. The steps of an exchange would add a half to
        # the client's own work for a lookup, so they begin where that is not enough.
        key, payload = exchange.keys[request.request_type], server.check_size(request.payload())
        timeout_s = self.timeout_s + request.wait_s
        begin_s = time.monotonic()
        reply = self.queries.ask(key, payload, timeout_s)
        if type(reply) is bytes and begin_s < exchange.next_hello_s:
            result = request.parse_plain(reply, server.instance)
            if result is not None:
                return result[0]
            if exchange.is_served(message := decode(reply)):
                return request.parse(message)
        query = ReadQuery(key, payload, timeout_s, begin_s + timeout_s)
        return self._run(exchange.finish_read(request, query, reply))

    def _router(self) -> str | None:
        """The id of the router that the session has a link to; None if it has none now."""
        with self.calls:
            return next(map(str, self.session.info.routers_zid()), None)

    def _run(self, steps: Steps[T]) -> T:
        """Run the steps one after another, and return their result."""
        return threads.run_steps(steps, self._take)

    def _take(self, step: Ask | Pause) -> bytes | NoReply | None:
        if isinstance(step, Pause):
            time.sleep(step.seconds)
            return None
        return self.queries.ask(step.key, step.payload, step.timeout_s)

    def _wait_for_server(self, deadline_s: float) -> None:
        """Ask until a server answers, because it may still be starting. Give up early if the
        network serves other trees only, because the name is then probably wrong."""
        next_check_s = time.monotonic() + _OTHER_TREES_GRACE_S
        while True:
            left_s = deadline_s - time.monotonic()
            try:
                self.greet(max(left_s, 0.1))
                return
            except ServerUnavailable:
                is_last = left_s <= _HELLO_PERIOD_S
                if is_last or time.monotonic() >= next_check_s:
                    trees = served_trees(self.session, _OTHER_TREES_TIMEOUT_S)
                    if is_last or (trees and self.tree not in trees):
                        raise ServerUnavailable(
                            no_server_message(self.tree, self._address, trees, self.timeout_s)
                        ) from None
                    next_check_s = time.monotonic() + _OTHER_TREES_PERIOD_S
            time.sleep(_HELLO_PERIOD_S)
