"""The connection of a client with several endpoints; see the package.

Thread safety: all functions and methods.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import TypeVar

from zenoh_tf._net import zenoh_config
from zenoh_tf._net.credentials import Credentials

from ..requests.request import Request
from ..session.connection import Connection, Listener
from .exchange import FailoverExchange
from .link_watch import LinkWatch
from .probe import serves
from .queries import WatchedQueries

T = TypeVar("T")


def open_connection(
    endpoint: str | Sequence[str],
    tree: str,
    timeout_s: float,
    credentials: Credentials,
    *,
    local: bool = True,
) -> Connection:
    """Connect to one endpoint, or to several; raises what `Connection` raises.

    `local`: as for `Connection`. With several, all requests go over Zenoh.
    """
    endpoints = zenoh_config.endpoints_of(endpoint)
    if len(endpoints) == 1:
        return Connection(endpoints, tree, timeout_s, credentials, local=local)
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
        super().__init__(endpoints, tree, timeout_s, credentials, local=False)
        self._watch = LinkWatch(
            self.session,
            self.calls,
            self.queries,
            tree,
            self.endpoints,
            on_moved=self.exchange.forget,
            serves=functools.partial(serves, tree=tree, credentials=credentials),
        )
        self._watch.start()

    @property
    def endpoint(self) -> str:
        return self.endpoints[0] if self._watch is None else self._watch.endpoint

    def call(self, request: Request[T]) -> T:
        return self._run(self.exchange.call(request))

    def expect(self, listener: Listener, silence_s: float) -> None:
        if self._watch is not None:
            self._watch.expect(listener, silence_s)

    def close(self) -> None:
        if self._watch is not None:
            self._watch.close()
        super().close()
