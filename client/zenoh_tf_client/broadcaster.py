"""`Broadcaster`: publishes transforms without waiting for a reply, as sensors need it."""

from __future__ import annotations

import contextlib
import threading
import time
import weakref
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import StampedTransform, keys, wire
from zenoh_tf.errors import LimitExceeded, ServerUnavailable

from . import columns
from .connection import Connection
from .session_calls import SessionCalls

#: Zenoh may report a new server before it reports that server's subscribers.
_MATCHING_TIMEOUT_S = 2.0
#: Reports of new servers that wait to be handled.
_QUEUED_REPORTS = 16


class Broadcaster:
    """Publishes transforms as one authority; made by `TransformClient.broadcaster`.

    One call sends one message, which the server commits atomically. The server sends no reply: it
    logs and counts what it rejects. The broadcaster keeps its static transforms and sends
    them again to every server that appears. A context manager, which closes itself at the end.

    Thread safety: all methods.
    """

    def __init__(self, connection: Connection, authority: str) -> None:
        """Use `TransformClient.broadcaster` instead.

        Args:
            connection: The connection to publish on.
            authority: The name to publish as, at most 255 bytes of UTF-8.

        Raises:
            InvalidArgumentException: `authority` is too long or not valid UTF-8.
            ServerUnavailable: The connection is closed.
        """
        self._authority = authority
        self._connection = connection
        self._lock = threading.Lock()
        self._statics: dict[str, StampedTransform] = {}
        self._servers: zenoh.Subscriber[Any] | None = None
        self._closed = False
        self._dynamic_publisher = self._publisher(static=False)
        self._static_publisher = self._publisher(static=True)

    def __repr__(self) -> str:
        state = "closed" if self._closed or self._connection.closed else "open"
        return (
            f"<Broadcaster {self._authority!r} at {self._connection.endpoint}, "
            f"tree {self._connection.tree!r}, {len(self._statics)} static, {state}>"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def authority(self) -> str:
        """Returns the name that this broadcaster publishes as."""
        return self._authority

    def send(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms at their stamps, without waiting for the server.

        The server drops transforms that are older than its cache time.

        Args:
            stampeds: One transform or several, each ``X_parent_child``: it maps coordinates in
                the child frame to coordinates in the parent frame. Metres; nanoseconds. Several
                are committed atomically, all or none of them.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send(StampedTransform("odom", "base", time.time_ns(), X_odom_base))``
        """
        self._put(self._dynamic_publisher, stampeds)

    def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold at all times, now and to every server that appears later.

        Args:
            stampeds: One transform or several, each ``X_parent_child`` as in `send`. Their
                stamps do not matter. A newer transform of a child frame replaces the older one.

        Raises:
            LimitExceeded: The message would be larger than 16 MiB.
            ServerUnavailable: The broadcaster or its client is closed.

        Example:
            ``wheels.send_static(StampedTransform("base", "camera", 0, X_base_camera))``
        """
        rows = _rows(stampeds)
        with self._lock:
            if self._servers is None and not self._closed:
                self._watch_servers()
            self._put(self._static_publisher, rows)
            self._statics.update((row.child_frame, row) for row in rows)

    def close(self) -> None:
        """Stop publishing. What was sent stays in the server. May be called again."""
        if self._connection.closed:  # nothing to undeclare, and a send may hold the locks for long
            self._closed = True
            return
        with self._lock:
            if self._closed:
                return
            self._closed = True
            servers = self._servers
        # Not under the lock, because the thread that watches for servers may be waiting for it.
        if servers is not None:
            _undeclare(servers.undeclare, self._connection.calls)
        self._dynamic_publisher.undeclare()
        self._static_publisher.undeclare()

    def _publisher(self, *, static: bool) -> _Publisher:
        key = keys.put(self._connection.tree, self._authority, static=static)
        return _Publisher(self._connection, key)

    @staticmethod
    def _put(
        publisher: _Publisher, stampeds: StampedTransform | Iterable[StampedTransform]
    ) -> None:
        payload = wire.pack(wire.commit_body(columns.commit(_rows(stampeds))))
        if len(payload) > wire.MAX_MESSAGE_BYTES:
            raise LimitExceeded(
                f"a message of {len(payload):,} bytes exceeds the limit of "
                f"{wire.MAX_MESSAGE_BYTES:,} bytes; send fewer transforms at once",
                field="message_bytes",
                limit=wire.MAX_MESSAGE_BYTES,
                value=len(payload),
            )
        publisher.put(payload)

    def _watch_servers(self) -> None:
        """Start a thread that resends the statics to each new server."""
        # Not a callback: Zenoh runs it on a non-daemon thread, which would keep a program that
        # never closes its client from ending.
        calls = self._connection.calls
        with calls:
            self._servers = self._connection.session.liveliness().declare_subscriber(
                keys.servers(self._connection.tree),
                FifoChannel(_QUEUED_REPORTS),
                history=False,
            )
            handler = self._servers.handler
        threading.Thread(
            target=_resend_statics,
            args=(weakref.ref(self), calls, handler),
            name="resend statics",
            daemon=True,
        ).start()

    def _resend(self) -> None:
        """Send all statics again, once a server subscribes to them."""
        deadline_s = time.monotonic() + _MATCHING_TIMEOUT_S
        while not self._static_publisher.has_subscribers() and time.monotonic() < deadline_s:
            if self._closed:
                return
            time.sleep(0.01)
        with self._lock:
            if self._statics and not self._closed:
                self._put(self._static_publisher, list(self._statics.values()))


def _resend_statics(
    broadcaster_ref: weakref.ref[Broadcaster], calls: SessionCalls, handler: Any
) -> None:
    """Resend a broadcaster's statics to each new server, until it is closed or collected."""
    while True:
        try:
            with calls:
                token = handler.recv()
            broadcaster = broadcaster_ref()
            if broadcaster is None:
                return
            if token.kind == zenoh.SampleKind.PUT:
                broadcaster._resend()
            del broadcaster  # or the wait for the next server would keep it alive
        except (zenoh.ZError, ServerUnavailable):  # the broadcaster or its client was closed
            return


class _Publisher:
    """A Zenoh publisher that one thread may close while others use it.

    Zenoh's own raises RuntimeError ("Already borrowed") in that case.
    """

    def __init__(self, connection: Connection, key: str) -> None:
        self._lock = threading.Lock()
        self._calls = connection.calls
        with self._calls:
            self._publisher: zenoh.Publisher | None = connection.session.declare_publisher(
                key,
                # A sensor that outruns the network waits; losing transforms unseen is worse.
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

    def put(self, payload: bytes) -> None:
        with self._calls, self._lock:
            if self._publisher is None:
                raise ServerUnavailable("the broadcaster is closed")
            try:
                self._publisher.put(payload)
            except zenoh.ZError as error:
                raise ServerUnavailable(f"cannot publish: {error}") from error

    def has_subscribers(self) -> bool:
        with self._calls, self._lock:
            if self._publisher is None:
                return False
            matching = self._publisher.matching_status.matching  # type: ignore[attr-defined]
            return bool(matching)  # it is not a bool

    def undeclare(self) -> None:
        with self._lock:
            publisher, self._publisher = self._publisher, None
            if publisher is not None:
                _undeclare(publisher.undeclare, self._calls)


def _undeclare(undeclare: Callable[[], object], calls: SessionCalls) -> None:
    """Call `undeclare`, unless the session is closed: then there is nothing to undeclare."""
    with contextlib.suppress(zenoh.ZError, ServerUnavailable), calls:
        undeclare()


def _rows(stampeds: StampedTransform | Iterable[StampedTransform]) -> list[StampedTransform]:
    return [stampeds] if isinstance(stampeds, StampedTransform) else list(stampeds)
