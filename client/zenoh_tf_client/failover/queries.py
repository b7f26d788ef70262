"""Queries of a session whose link may be ended while they are under way.

Thread safety: all methods.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager

import zenoh

from zenoh_tf._net.queries import NoReply, Queries
from zenoh_tf.errors import ServerUnavailable


class WatchedQueries(Queries):
    """The queries of one session, which know whether one is under way."""

    def __init__(
        self,
        session: zenoh.Session,
        calls: AbstractContextManager[None],
        client_id: str,
        server: str,
    ) -> None:
        super().__init__(session, calls, client_id, server)
        #: Set when a query is sent.
        self.sent = threading.Event()
        #: Replies so far. A lost count does no harm.
        self.heard = 0
        self._numbers = itertools.count()
        #: Changed by single operations of a dictionary, which need no lock.
        self._under_way: dict[int, zenoh.CancellationToken] = {}

    @property
    def are_under_way(self) -> bool:
        """True if a reply is awaited."""
        return bool(self._under_way)

    def end_all(self) -> None:
        """End the queries that are under way, as if their server had gone away.

        One that was sent while its link was closing gets no reply, and Zenoh does not end it.
        """
        for token in list(self._under_way.values()):
            token.cancel()

    def ask(
        self,
        key: zenoh.KeyExpr,
        payload: bytes,
        timeout_s: float,
        token: zenoh.CancellationToken | None = None,
    ) -> bytes | NoReply:
        token = token or zenoh.CancellationToken()
        number = self._begin(token)
        try:
            reply = super().ask(key, payload, timeout_s, token)
        except ServerUnavailable:
            if not token.is_cancelled:
                raise
            return self.went_away()  # it was ended before it was sent
        finally:
            self._under_way.pop(number, None)
        if type(reply) is bytes:
            self.heard += 1
        return reply

    def send(
        self,
        key: zenoh.KeyExpr,
        payload: bytes,
        timeout_s: float,
        replied: Callable[[zenoh.Reply], None],
        ended: Callable[[], None],
        token: zenoh.CancellationToken,
    ) -> None:
        number = self._begin(token)

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:  # else it is Zenoh's own, of a query that has timed out
                self.heard += 1
            replied(reply)

        def end() -> None:
            if self._under_way.pop(number, None) is not None:
                ended()

        try:
            super().send(key, payload, timeout_s, hear, end, token)
        except BaseException as error:
            if isinstance(error, ServerUnavailable) and token.is_cancelled:
                end()
                return
            self._under_way.pop(number, None)
            raise

    def _begin(self, token: zenoh.CancellationToken) -> int:
        number = next(self._numbers)
        self._under_way[number] = token
        if not self.sent.is_set():
            self.sent.set()
        return number
