"""Publishes transforms without waiting for anybody: the sensor's side."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Self

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import StampedTransform, keys, wire
from zenoh_tf.errors import LimitExceeded, ServerUnavailable

from . import columns

#: A server's token may arrive before the news of its subscribers does.
_MATCHING_TIMEOUT_S = 2.0
#: News of servers that are not yet handled.
_TOKENS = 16


class Broadcaster:
    """Puts transforms as one authority. Thread safety: all methods.

    One call is one message, committed atomically by the server; nobody answers. Static
    transforms are kept here and announced again whenever a server appears.
    """

    def __init__(self, session: zenoh.Session, tree: str, authority: str) -> None:
        self.authority = authority
        self._session = session
        self._tree = tree
        self._lock = threading.Lock()
        self._statics: dict[str, StampedTransform] = {}
        self._servers: zenoh.Subscriber[Any] | None = None
        self._closed = False
        self._dynamic = self._publisher(static=False)
        self._static = self._publisher(static=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def send(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms, `X_parent_child` each. Rows older than the server's cache are
        dropped there. Raises LimitExceeded for more than one message holds."""
        self._put(self._dynamic, stampeds)

    def send_static(self, stampeds: StampedTransform | Iterable[StampedTransform]) -> None:
        """Publish transforms that hold for all times, now and to every server to come."""
        rows = _rows(stampeds)
        with self._lock:
            if self._servers is None and not self._closed:
                self._watch_servers()
            self._put(self._static, rows)
            self._statics.update((row.child_frame, row) for row in rows)

    def close(self) -> None:
        """Stop announcing; may be called again. What was sent stays in the server."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            servers = self._servers
        # Outside of the lock, for which the thread behind `servers` may be waiting.
        if servers is not None:
            servers.undeclare()
        self._dynamic.undeclare()
        self._static.undeclare()

    def _publisher(self, *, static: bool) -> _Publisher:
        return _Publisher(self._session, keys.put(self._tree, self.authority, static=static))

    @staticmethod
    def _put(
        publisher: _Publisher, stampeds: StampedTransform | Iterable[StampedTransform]
    ) -> None:
        payload = wire.pack(wire.commit_body(columns.commit(_rows(stampeds))))
        if len(payload) > wire.MAX_MESSAGE_BYTES:
            raise LimitExceeded(
                f"a message of {len(payload)} bytes, at most {wire.MAX_MESSAGE_BYTES}",
                field="message_bytes",
                limit=wire.MAX_MESSAGE_BYTES,
                value=len(payload),
            )
        publisher.put(payload)

    def _watch_servers(self) -> None:
        # A thread of our own, not a callback of Zenoh's: that runs on a thread which a
        # process that ends without closing would wait for, for ever.
        tokens: FifoChannel[zenoh.Sample] = FifoChannel(_TOKENS)
        self._servers = self._session.liveliness().declare_subscriber(
            keys.servers(self._tree), tokens, history=False
        )
        handler = self._servers.handler
        threading.Thread(
            target=self._announce_to_servers, args=(handler,), name="statics", daemon=True
        ).start()

    def _announce_to_servers(self, handler: Any) -> None:
        while True:
            try:
                token = handler.recv()
            except zenoh.ZError:  # undeclared
                return
            if token.kind == zenoh.SampleKind.PUT:
                self._announce()

    def _announce(self) -> None:
        deadline_s = time.monotonic() + _MATCHING_TIMEOUT_S
        while not self._static.has_subscribers() and time.monotonic() < deadline_s:
            if self._closed:
                return
            time.sleep(0.01)
        with self._lock:
            if self._statics and not self._closed:
                self._put(self._static, list(self._statics.values()))


class _Publisher:
    """A publisher that one thread may close while others use it, where Zenoh's own raises
    RuntimeError ("Already borrowed")."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._lock = threading.Lock()
        self._publisher: zenoh.Publisher | None = session.declare_publisher(
            key,
            # A sensor that outruns the network waits; losing transforms unseen is worse.
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def put(self, payload: bytes) -> None:
        with self._lock:
            if self._publisher is None:
                raise ServerUnavailable("the broadcaster is closed")
            try:
                self._publisher.put(payload)
            except zenoh.ZError as error:
                raise ServerUnavailable(f"cannot publish: {error}") from error

    def has_subscribers(self) -> bool:
        with self._lock:
            if self._publisher is None:
                return False
            matching = self._publisher.matching_status.matching  # type: ignore[attr-defined]
            return bool(matching)  # it is not a bool

    def undeclare(self) -> None:
        with self._lock:
            publisher, self._publisher = self._publisher, None
            if publisher is not None:
                publisher.undeclare()


def _rows(stampeds: StampedTransform | Iterable[StampedTransform]) -> list[StampedTransform]:
    return [stampeds] if isinstance(stampeds, StampedTransform) else list(stampeds)
