"""A Zenoh publisher of transforms that one thread may close while others use it.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable
from typing import Final

import zenoh

from zenoh_tf import StampedTransform, wire
from zenoh_tf._core import TransformRows
from zenoh_tf.errors import LimitExceeded, ServerUnavailable

from ..session.calls import SessionCalls
from ..session.connection import Connection

#: How often a connection that can fail over may check that what is published still gets anywhere.
_SILENCE_S: Final = 1.0


class Publisher:
    """Publishes on one key. Zenoh's own publisher raises RuntimeError ("Already borrowed") if it
    is closed while it is used."""

    def __init__(self, connection: Connection, key: str) -> None:
        """Raises ServerUnavailable if the connection is closed."""
        self._lock = threading.Lock()
        self._calls = connection.calls
        self._calls.add_owner(self)
        self.heard = 0  # nothing answers puts
        connection.watch_connection(self, _SILENCE_S)
        with self._calls:
            self._publisher: zenoh.Publisher | None = connection.session.declare_publisher(
                key,
                # A sensor that outruns the network waits; losing transforms unseen is worse.
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

    @property
    def closed(self) -> bool:
        """True once nothing is published any more."""
        return self._publisher is None

    def connection_changed(self) -> None:
        """Zenoh publishes through the new connection by itself."""

    def put(self, payload: bytes) -> None:
        """Publish a message. Raises ServerUnavailable if the publisher or its session is closed."""
        with self._calls, self._lock:
            if self._publisher is None:
                raise ServerUnavailable("the broadcaster is closed")
            try:
                self._publisher.put(payload)
            except zenoh.ZError as error:
                raise ServerUnavailable(f"cannot publish: {error}") from error

    def has_subscribers(self) -> bool:
        """Whether a server receives what is published; Zenoh may learn it with a delay."""
        with self._calls, self._lock:
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

    Raises LimitExceeded if they are more than any server accepts by default.
    """
    rows = [stampeds] if isinstance(stampeds, StampedTransform) else stampeds
    commit = wire.Commit(TransformRows.of(rows), announce=announce)
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
