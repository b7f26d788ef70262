"""Sensors' puts: one message is one transaction, a bad one harms nobody.

A thread per subscriber commits message by message. The channel in front of it is bounded;
a full one holds the publisher back instead of losing transforms.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import keys, wire
from zenoh_tf.errors import TransformException

from .complaints import Complaints
from .limits import Limits

#: Messages between Zenoh's receiver and the ingest thread.
_QUEUE = 256


@dataclass(slots=True)
class PutCounters:
    """Part of the statistics of `info`."""

    puts: int = 0
    put_transforms: int = 0
    bad_puts: int = 0
    dropped_as_too_old: int = 0

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


class Ingest:
    """Commits the puts on ``set/*`` and ``static/*`` of a tree."""

    def __init__(
        self, commit: Callable[[wire.Commit], Any], counters: PutCounters, limits: Limits
    ) -> None:
        self._commit = commit
        self._limits = limits
        self._counters = counters
        self._lock = threading.Lock()
        self._complaints = Complaints(logging.getLogger("zenoh_tf.server.ingest"))
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._threads: list[threading.Thread] = []

    def start(self, session: zenoh.Session, tree: str) -> None:
        for static in (False, True):
            channel: FifoChannel[zenoh.Sample] = FifoChannel(_QUEUE)
            subscriber = session.declare_subscriber(keys.puts(tree, static=static), channel)
            self._subscribers.append(subscriber)
            # The handler, not the subscriber: undeclaring one that a thread waits on fails.
            thread = threading.Thread(
                target=self._drain,
                args=(subscriber.handler, static),
                name="ingest-static" if static else "ingest",
                daemon=True,
            )
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.undeclare()
        for thread in self._threads:
            thread.join(timeout=0.5)

    def _drain(self, handler: Any, static: bool) -> None:
        while True:
            try:
                sample = handler.recv()
            except zenoh.ZError:  # undeclared
                return
            if sample.kind == zenoh.SampleKind.PUT:
                self._take(str(sample.key_expr), sample.payload.to_bytes(), static)

    def _take(self, key: str, payload: bytes, static: bool) -> None:
        authority = key
        try:
            authority = keys.last_name(key)
            commit = wire.parse_commit(wire.unpack(payload, self._limits.message_bytes))
            self._limits.check("rows", commit.rows)
            # The key decides: it is what Zenoh's access control has checked.
            commit.authority, commit.static = authority, static
            commit.drop_old = True
            commit.read_names, commit.read_versions = [], None
            stored = self._commit(commit)
        except Exception as error:
            with self._lock:
                self._counters.bad_puts += 1
            kind = type(error).__name__
            known = isinstance(error, TransformException) and error.field
            where = f" (field {error.field})" if known else ""  # type: ignore[attr-defined]
            self._complaints.warn(f"put of {authority!r}", f"{kind}: {error}{where}")
            return
        kept = int(stored.sum())
        with self._lock:
            self._counters.puts += 1
            self._counters.put_transforms += kept
            self._counters.dropped_as_too_old += commit.rows - kept
