"""A Zenoh publisher of transforms that one thread may close while others use it.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable

import zenoh

from zenoh_tf import StampedTransform, wire
from zenoh_tf._zenoh.calls import SessionCalls
from zenoh_tf.errors import LimitExceeded, ServerUnavailable

from ..requests.columns import transform_rows
from ..session.connection import Connection


class Publisher:
    """Publishes on one key. Zenoh's own publisher raises RuntimeError ("Already borrowed") if it
    is closed while it is used."""

    def __init__(self, connection: Connection, key: str) -> None:
        """Raises ServerUnavailable if the connection is closed."""
        self._lock = threading.Lock()  # of the next two
        self._connection = connection
        self._key = key
        connection.add_user(self)  # before it is declared, or it might miss a change
        self._calls = connection.calls
        self._publisher: zenoh.Publisher | None = None
        with self._lock:
            self._declare()

    @property
    def closed(self) -> bool:
        """True once nothing is published any more."""
        return self._publisher is None

    def connection_changed(self) -> None:
        """Publish in the connection's new session."""
        with self._lock, contextlib.suppress(ServerUnavailable):  # closed meanwhile
            if self._publisher is not None:
                self._declare()

    def _declare(self) -> None:
        """Declare the publisher in the connection's session. Requires the lock."""
        link = self._connection.link
        link.calls.add_owner(self)
        with link.calls:
            self._publisher = link.session.declare_publisher(
                self._key,
                # A sensor that outruns the network waits; losing transforms unseen is worse.
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        self._calls = link.calls

    def put(self, payload: bytes) -> None:
        """Publish a message.

        Raises ServerUnavailable if the publisher or its session is closed, and what
        `ServerInfo.raise_read_only` raises if the server accepts no writes.
        """
        server = self._connection.server
        if server is not None and server.primary is not None:
            server.raise_read_only()
        with self._lock, self._calls:
            if self._publisher is None:
                raise ServerUnavailable("the broadcaster is closed")
            try:
                self._publisher.put(payload)
            except zenoh.ZError as error:
                raise ServerUnavailable(f"cannot publish: {error}") from error

    def has_subscribers(self) -> bool:
        """Whether a server receives what is published; Zenoh may learn it with a delay."""
        with self._lock, self._calls:
            if self._publisher is None:
                return False
            matching = self._publisher.matching_status.matching  # type: ignore[attr-defined]
            return bool(matching)  # it is not a bool

    def undeclare(self) -> None:
        """Close the publisher. May be called again."""
        if self._calls.closed:  # nothing to undeclare, and a put may hold the lock for long
            return
        with self._lock:
            publisher, self._publisher = self._publisher, None
            if publisher is not None:
                undeclare_unless_closed(publisher.undeclare, self._calls)


def undeclare_unless_closed(undeclare: Callable[[], object], calls: SessionCalls) -> None:
    """Call `undeclare` inside the session; one that is closed has nothing to undeclare."""
    with contextlib.suppress(zenoh.ZError, ServerUnavailable), calls:
        undeclare()


def message(
    stampeds: StampedTransform | Iterable[StampedTransform], *, announce: bool = False
) -> bytes:
    """The bytes of one put, of one transform or several.

    Raises LimitExceeded if they are more than any server accepts by default, and
    InvalidArgumentException if they are anything else.
    """
    rows = [stampeds] if isinstance(stampeds, StampedTransform) else stampeds
    commit = wire.Commit(transform_rows(rows), announce=announce)
    payload = wire.pack(wire.commit_body(commit))
    if len(payload) > wire.MAX_MESSAGE_BYTES:
        raise LimitExceeded(
            f"a message of {len(payload):,} bytes exceeds the limit of "
            f"{wire.MAX_MESSAGE_BYTES:,} bytes; send fewer transforms at once",
            field="message_bytes",
            limit=wire.MAX_MESSAGE_BYTES,
            value=len(payload),
        )
    return payload
