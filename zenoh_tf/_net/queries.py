"""Sends one query to the server of a tree, and gathers its reply.

Thread safety: all methods; calls of different threads run side by side.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Final

import zenoh
from zenoh.handlers import Callback

from ..errors import ServerUnavailable
from . import keys

#: The error reply that Zenoh makes up when no server replies in time.
ZENOH_TIMEOUT: Final = b"Timeout"
_EACH_REPLY: Final = zenoh.ConsolidationMode.NONE


@dataclass(frozen=True, slots=True)
class NoReply:
    """No reply came to a query."""

    reason: str
    at_once: bool  # the query ended without a reply: no server, or its rules deny the request


class Queries:
    """The queries of one session."""

    def __init__(
        self,
        session: zenoh.Session,
        calls: AbstractContextManager[None],
        client_id: str,
        server: str,
    ) -> None:
        """`calls`: to be entered around each call into the session. `client_id`: what
        the server distinguishes clients by. `server`: what messages call it."""
        self._session = session
        self._calls = calls
        self._attachment = f"{client_id} {keys.TAKES_PARTS}".encode()
        self._server = server

    def ask(self, key: zenoh.KeyExpr, payload: bytes, timeout_s: float) -> bytes | NoReply:
        """Send a request, and return the bytes of the first reply, or why there is none.

        Raises:
            ServerUnavailable: The session is closed.
        """
        parts: ReplyParts | None = None
        data: bytes | None = None
        try:
            with self._calls:
                for reply in self._session.get(
                    key,
                    payload=payload,
                    attachment=self._attachment,
                    timeout=timeout_s,
                    consolidation=_EACH_REPLY,
                ):
                    sample = reply.ok
                    if sample is not None and sample.attachment is None:  # the common case
                        return sample.payload.to_bytes()
                    parts = parts or ReplyParts()
                    data = parts.add(reply)
                    if data is not None:
                        break
        except zenoh.ZError as error:
            raise ServerUnavailable(f"{self._server}: {error}") from error
        return self.outcome(data, timeout_s)

    def send(
        self,
        key: zenoh.KeyExpr,
        payload: bytes,
        timeout_s: float,
        replied: Callable[[zenoh.Reply], None],
        ended: Callable[[], None],
        token: zenoh.CancellationToken,
    ) -> None:
        """Send a request, and return without its reply.

        Zenoh calls `replied` with each reply, and `ended` after the last one, both on a thread
        of its own. They must not block. `token` cancels the query.

        Raises:
            ServerUnavailable: The session is closed.
        """
        # Zenoh would start a thread for a callback that is indirect.
        callback = Callback(replied, ended, indirect=False)
        try:
            with self._calls:
                self._session.get(
                    key,
                    callback,
                    payload=payload,
                    attachment=self._attachment,
                    timeout=timeout_s,
                    consolidation=_EACH_REPLY,
                    cancellation_token=token,
                )
        except zenoh.ZError as error:
            raise ServerUnavailable(f"{self._server}: {error}") from error

    def outcome(self, data: bytes | None, timeout_s: float) -> bytes | NoReply:
        """Return a reply's payload, or why there is none; None stands for a query without one."""
        if data is None:
            # Zenoh ends a query at once if no server is there, or when the server goes away.
            return self.went_away()
        if data == ZENOH_TIMEOUT:
            reason = f"no answer from {self._server} within {timeout_s:g} s"
            return NoReply(reason, at_once=False)
        return data

    def went_away(self) -> NoReply:
        """Return what a request ends with if the server goes away before it answers."""
        return NoReply(
            f"{self._server} is not there, or went away before it answered", at_once=True
        )


class ReplyParts:
    """Gathers the payload of one reply. A long one comes in parts, each with the length of the
    whole as its attachment."""

    __slots__ = ("_length", "_parts")

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, reply: zenoh.Reply) -> bytes | None:
        """Return the payload if this part completes it."""
        sample = reply.ok
        if sample is None:
            return reply.err.payload.to_bytes()  # type: ignore[union-attr]
        if sample.attachment is None:
            return sample.payload.to_bytes()
        self._parts.append(sample.payload.to_bytes())
        self._length += len(self._parts[-1])
        if self._length == int(sample.attachment.to_bytes()):
            return b"".join(self._parts)
        return None
