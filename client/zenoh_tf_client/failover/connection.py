"""The connection of a client with several endpoints; see the package.

Thread safety: all functions and methods.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from typing import Final, TypeVar

import zenoh

from zenoh_tf import wire
from zenoh_tf._net import keys, zenoh_config
from zenoh_tf._net.credentials import Credentials
from zenoh_tf._net.queries import Queries
from zenoh_tf.errors import TransformException

from ..requests import info
from ..requests.request import Request
from ..session.calls import SessionCalls
from ..session.connection import Connection, ConnectionUser
from ..session.opening import try_session
from .exchange import FailoverExchange
from .link_watch import LinkWatch
from .queries import WatchedQueries

T = TypeVar("T")

#: How long each step may take: an endpoint that needs longer is no gain.
_STEP_S: Final = 1.0


def open_connection(
    endpoint: str | Sequence[str], tree: str, timeout_s: float, credentials: Credentials
) -> Connection:
    """Connect to one endpoint, or to several; raises what `Connection` raises."""
    endpoints = zenoh_config.endpoints_of(endpoint)
    if len(endpoints) == 1:
        return Connection(endpoints, tree, timeout_s, credentials)
    return FailoverConnection(endpoints, tree, timeout_s, credentials)


class FailoverConnection(Connection):
    """A session with the first of several servers that answers."""

    _exchange_type = FailoverExchange
    _queries_type = WatchedQueries
    exchange: FailoverExchange
    queries: WatchedQueries

    def __init__(
        self, endpoints: Sequence[str], tree: str, timeout_s: float, credentials: Credentials
    ) -> None:
        """Connect; raises what `Connection` raises."""
        self._watch: LinkWatch | None = None
        super().__init__(endpoints, tree, timeout_s, credentials)
        self._watch = LinkWatch(
            self.session,
            self.calls,
            self.queries,
            tree,
            self.endpoints,
            on_moved=self.exchange.forget,
            serves=functools.partial(_serves, tree=tree, credentials=credentials),
        )
        self._watch.start()

    @property
    def endpoint(self) -> str:
        return self.endpoints[0] if self._watch is None else self._watch.endpoint

    def call(self, request: Request[T]) -> T:
        return self._run(self.exchange.call(request))

    def watch_connection(self, user: ConnectionUser, silence_s: float) -> None:
        if self._watch is not None:
            self._watch.watch_connection(user, silence_s)

    def close(self) -> None:
        if self._watch is not None:
            self._watch.close()
        super().close()


def _serves(endpoint: str, tree: str, credentials: Credentials) -> bool:
    """Whether this client is let in there, and a replica or the server answers `hello`.

    A replica listens before it has its copy, and a router may have lost its servers.
    """
    try:
        session = try_session([endpoint], _STEP_S, credentials)
    except (zenoh.ZError, TransformException):
        return False
    calls = SessionCalls(session.close)
    try:
        queries = Queries(session, calls, str(session.zid()), f"the server at {endpoint}")
        hello = wire.pack(info.hello(credentials.user, clock_ns=time.time_ns()).body())
        with calls:
            routers = list(map(str, session.info.routers_zid()))
        near = [keys.replica_request(tree, router, "hello") for router in routers]
        for key in (*near, keys.request(tree, "hello")):
            reply = queries.ask(zenoh.KeyExpr(key), hello, _STEP_S)
            if type(reply) is bytes and "error" not in wire.unpack(reply, wire.MAX_REPLY_BYTES):
                return True
    except TransformException:
        pass
    finally:
        calls.close()
    return False
