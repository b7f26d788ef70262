"""Sends one query to the server of a tree, and gathers its reply.

Thread safety: all methods; calls of different threads run side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import zenoh

from zenoh_tf import keys, wire
from zenoh_tf.errors import ServerUnavailable

from .session_calls import SessionCalls

#: The error reply that Zenoh makes up when no server replies in time.
_ZENOH_TIMEOUT: Final = b"Timeout"


@dataclass(frozen=True, slots=True)
class NoReply:
    """No reply came to a query."""

    reason: str
    at_once: bool  # the query ended without a reply: no server, or its rules deny the request


class Queries:
    """The queries of one session."""

    def __init__(
        self, session: zenoh.Session, calls: SessionCalls, client_id: str, server: str
    ) -> None:
        """`client_id`: what the server tells clients apart by. `server`: what messages call it."""
        self._session = session
        self._calls = calls
        self._attachment = f"{client_id} {keys.TAKES_PARTS}".encode()
        self._server = server

    def ask(self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float) -> wire.Message | NoReply:
        """Send a request, and return the first reply, or why there is none.

        Raises:
            ServerUnavailable: The session is closed.
            ProtocolError: The reply is malformed.
        """
        try:
            with self._calls:
                data = self._first_reply(key, payload, timeout_s)
        except zenoh.ZError as error:
            raise ServerUnavailable(f"{self._server}: {error}") from error
        if data is None:
            # Zenoh ends a query at once if no server is there, or when the server goes away.
            return self.went_away()
        if data == _ZENOH_TIMEOUT:
            return self.timed_out(timeout_s)
        return wire.unpack(data, wire.MAX_REPLY_BYTES)

    def went_away(self) -> NoReply:
        """Return what a request ends with if the server goes away before it answers."""
        return NoReply(
            f"{self._server} is not there, or went away before it answered", at_once=True
        )

    def timed_out(self, timeout_s: float) -> NoReply:
        """Return what a request ends with if the server does not answer in time."""
        return NoReply(f"no answer from {self._server} within {timeout_s:g} s", at_once=False)

    def _first_reply(self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float) -> bytes | None:
        """Return the reply's payload; None if the query ended without one, or within one.

        A long reply comes in parts; the attachment of each is the length of the whole.
        """
        parts: list[bytes] = []
        length = 0
        replies = self._session.get(
            key,
            payload=payload,
            attachment=self._attachment,
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        for reply in replies:
            sample = reply.ok
            if sample is None:
                return reply.err.payload.to_bytes()  # type: ignore[union-attr]
            if sample.attachment is None:
                return sample.payload.to_bytes()
            parts.append(sample.payload.to_bytes())
            length += len(parts[-1])
            if length == int(sample.attachment.to_bytes()):
                return b"".join(parts)
        return None
