"""One Zenoh session of a client, at one endpoint, and whether its tree is still there.

Thread safety: all methods; `is_lost` by one thread.
"""

from __future__ import annotations

from typing import Any, Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf._net import keys
from zenoh_tf._net.queries import Queries
from zenoh_tf._zenoh.calls import SessionCalls

#: Reports between two looks; the newest count.
_QUEUED_REPORTS: Final = 64


class Link:
    """A session at one endpoint. Close it with `close`."""

    def __init__(self, session: zenoh.Session, endpoint: str, tree: str, server: str) -> None:
        """`server`: what messages call the server."""
        self.session = session
        self.endpoint = endpoint
        self.calls = SessionCalls(session.close)
        self.calls.add_owner(self)
        # Each query carries the client's id, so that the server can hold clients apart. The token
        # under the same id lets the server see when the client is gone.
        self.client_id = str(session.zid())
        self.queries = Queries(session, self.calls, self.client_id, server)
        self._tree = tree
        self._token = session.liveliness().declare_token(keys.client(tree, self.client_id))
        self._events: zenoh.LinkEventsListener[Any] | None = None
        self._tokens: zenoh.Subscriber[Any] | None = None
        self._servers: set[str] = set()  # whose tokens are there
        self._had_server = False
        self._was_cut = False

    def __del__(self) -> None:
        # Zenoh would close the session when it is freed, outside of `_calls`.
        if hasattr(self, "calls"):
            self.calls.add_owner(self)  # the garbage collector has cleared that reference
            self.calls.close()

    def close(self) -> None:
        """Close the session; calls of other threads fail soon. May be called again."""
        self.calls.close()

    def router(self) -> str | None:
        """The id of the router that the session is connected to; None if to none now. Raises
        ServerUnavailable if it is closed."""
        with self.calls:
            return next(map(str, self.session.info.routers_zid()), None)

    def watch(self) -> None:
        """Begin to follow whether it is lost, before a server has answered. Raises
        ServerUnavailable if it is closed."""
        # Not callbacks: Zenoh would run them on threads of its own, also while Python ends.
        with self.calls:
            self._events = self.session.info.declare_link_events_listener(
                RingChannel(_QUEUED_REPORTS), history=False
            )
            self._tokens = self.session.liveliness().declare_subscriber(
                keys.servers(self._tree), RingChannel(_QUEUED_REPORTS), history=True
            )

    def is_lost(self) -> bool:
        """Whether the connection has ended once, or the router there has lost the server of the
        tree. Raises ServerUnavailable if it is closed."""
        events, tokens = self._events, self._tokens
        assert events is not None
        assert tokens is not None
        with self.calls:
            try:
                while (event := events.try_recv()) is not None:
                    self._was_cut |= event.kind == zenoh.SampleKind.DELETE
                while (token := tokens.handler.try_recv()) is not None:
                    if token.kind == zenoh.SampleKind.PUT:
                        self._servers.add(str(token.key_expr))
                        self._had_server = True
                    else:
                        self._servers.discard(str(token.key_expr))
                # Also if it was cut before the events were followed.
                self._was_cut |= not list(self.session.info.routers_zid())
            except zenoh.ZError:  # closed meanwhile
                self._was_cut = True
        return self._was_cut or (self._had_server and not self._servers)
