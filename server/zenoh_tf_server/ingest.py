"""Ingest of published transforms: each put is one transaction, and a bad one harms no other.

One thread per subscriber commits message by message. The channel before it is bounded; a full
channel holds the publishers back, so no transform is lost.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import keys, wire
from zenoh_tf.errors import TransformException
from zenoh_tf.text import quoted

from .limits import Limits
from .rate_limited_log import RateLimitedLog
from .refusals import Refusals

#: Messages between Zenoh's receiver and an ingest thread.
_CHANNEL: Final = 256
_JOIN_TIMEOUT_S: Final = 0.5


@dataclass(slots=True)
class PutCounters:
    """Counters of all published messages, part of `stats`."""

    puts: int = 0
    put_transforms: int = 0
    bad_puts: int = 0
    dropped_as_too_old: int = 0

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


class Ingest:
    """Commits the puts on ``set/*`` and ``static/*`` of a tree."""

    def __init__(
        self,
        commit: Callable[[wire.Commit], Any],
        counters: PutCounters,
        refusals: Refusals,
        limits: Limits,
    ) -> None:
        self._commit = commit
        self._counters = counters
        self._refusals = refusals
        self._limits = limits
        self._lock = threading.Lock()  # of the counters: two threads ingest
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ingest"))
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._threads: list[threading.Thread] = []

    def start(self, session: zenoh.Session, tree: str) -> None:
        for static in (False, True):
            channel: FifoChannel[zenoh.Sample] = FifoChannel(_CHANNEL)
            subscriber = session.declare_subscriber(keys.puts(tree, static=static), channel)
            self._subscribers.append(subscriber)
            # The thread receives on the handler: undeclaring a subscriber fails while a thread
            # waits on the subscriber itself.
            thread = threading.Thread(
                target=self._run,
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
            thread.join(_JOIN_TIMEOUT_S)

    def _run(self, handler: Any, static: bool) -> None:
        while True:
            try:
                sample = handler.recv()
            except zenoh.ZError:  # undeclared
                return
            if sample.kind == zenoh.SampleKind.PUT:
                self._ingest(str(sample.key_expr), sample.payload.to_bytes(), static)

    def _ingest(self, key: str, payload: bytes, static: bool) -> None:
        """Commit one message. Never raises: an error is counted and logged."""
        authority = None
        transforms = 1  # a message that cannot be parsed counts as one transform
        try:
            authority = keys.last_name(key)
            commit = wire.parse_commit(self._limits.unpack(payload))
            transforms = commit.rows
            self._limits.check("rows", commit.rows)
            # The key counts, not the message: Zenoh's access control has checked the key.
            commit.authority, commit.static = authority, static
            commit.drop_old = True
            commit.read_names, commit.read_versions = [], None
            stored = self._commit(commit)
        except Exception as error:
            self._refuse(key, authority, transforms, error)
            return
        if commit.rows:
            self._refusals.accept(authority)
        kept = int(stored.sum())
        with self._lock:
            self._counters.puts += 1
            self._counters.put_transforms += kept
            if not commit.announce:  # what an announcement leaves out is not old
                self._counters.dropped_as_too_old += commit.rows - kept

    def _refuse(self, key: str, authority: str | None, transforms: int, error: Exception) -> None:
        field = error.field if isinstance(error, TransformException) else None
        where = f" (field {field})" if field else ""
        reason = f"{type(error).__name__}: {error}{where}"
        if authority is not None:
            self._refusals.refuse(authority, transforms, reason)
        source = key if authority is None else authority
        self._log.warn(f"put of {quoted(source)}", reason)
        with self._lock:  # last: a client that sees the count finds the reason as well
            self._counters.bad_puts += 1
