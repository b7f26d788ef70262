"""Ingest of published transforms: each put is one transaction, and a bad one harms no other.

One thread receives the puts from Zenoh, sorts them into a queue per authority (`put_queues`), and
commits the small ones. A second thread commits the large ones, so that nobody waits for them.
docs/explanation/decisions/0009-puts-queue-per-authority.md has the reasons and the figures.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import threads, wire
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys
from zenoh_tf.bounded_map import BoundedMap
from zenoh_tf.errors import InvalidArgumentException, TransformException
from zenoh_tf.text import quoted

from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from .clock_offsets import ClockOffsets
from .future_stamps import FutureStamps
from .put_queues import LARGE_BYTES, Put, PutQueues, Turn
from .refusals import Refusals

#: Puts between Zenoh's receiver and the ingest thread, which empties it after every turn.
_CHANNEL: Final = 64
#: A queue that is filled above this part of its limits presses: the receiver holds back.
_PRESSING: Final = 0.25
#: The receiver accepts no more at once than this part of a queue's limit, unless it is late.
_BATCH: Final = 0.125
#: While a queue presses, the puts of others are received from Zenoh at least this often.
_HOLD_BACK_S: Final = 0.025
#: The same while it is alone, and there is room.
_HOLD_BACK_ALONE_S: Final = 0.1
#: An authority is alone after no other one has sent for this long.
_ALONE_S: Final = 1.0
#: Keys whose authority is remembered.
_KNOWN_KEYS: Final = 4096


@dataclass(slots=True)
class PutCounters:
    """Counters of all published messages, part of `stats`."""

    puts: int = 0
    put_transforms: int = 0
    bad_puts: int = 0
    dropped_as_too_old: int = 0
    dropped_by_queue: int = 0  # messages
    flagged_as_future: int = 0  # transforms stored although they are beyond --max-future-s

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


class Ingest:
    """Commits the puts on ``set/*`` and ``static/*`` of a tree."""

    def __init__(
        self,
        commit: Callable[[wire.Commit, int | None], Any],
        counters: PutCounters,
        refusals: Refusals,
        limits: Limits,
        clocks: ClockOffsets,
        future: FutureStamps,
    ) -> None:
        """`commit`: commits to the tree; its second argument is the latest stamp to store."""
        self._commit = commit
        self._counters = counters
        self._refusals = refusals
        self._limits = limits
        self._clocks = clocks
        self._future = future
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ingest"))
        self._max_queue_bytes = limits.put_queue_bytes
        self._lock = threading.Condition()  # of the queues and the counters
        self._queues = PutQueues(limits.put_queue_bytes, limits.put_queues_bytes)
        self._sources = BoundedMap[str, tuple[str, bool] | None](_KNOWN_KEYS)  # by key
        self._subscriber: zenoh.Subscriber[Any] | None = None
        self._threads: list[threading.Thread] = []
        self._closing = False
        self._idle = False  # the receiving thread has found nothing to commit
        # The receiver's: only its thread uses them.
        self._pressing: set[str] = set()
        self._last_authority = ""
        self._last_seen_s = self._other_seen_s = -_ALONE_S
        self._received_s = 0.0
        self._served = 0  # puts since the receiver took some last

    def start(self, session: zenoh.Session, tree: str) -> None:
        """Start to receive the puts of a tree."""
        # One channel for both kinds of puts: else an authority's order would be lost.
        channel: FifoChannel[zenoh.Sample] = FifoChannel(_CHANNEL)
        self._subscriber = session.declare_subscriber(keys.all_puts(tree), channel)
        # The thread receives on the handler: undeclaring a subscriber fails while a thread waits
        # on the subscriber itself.
        handler = self._subscriber.handler
        for name, run, arguments in (
            ("ingest", self._receive_and_serve, (handler,)),
            ("ingest-large", self._serve_large, ()),
        ):
            self._threads.append(threads.start(name, run, *arguments))

    def close(self) -> None:
        """Stop receiving. Puts that wait in a queue are not committed any more."""
        with self._lock:
            self._closing = True
            self._lock.notify_all()
        if self._subscriber is not None:
            self._subscriber.undeclare()
        threads.join(*self._threads)

    def add(self, puts: list[Put], *, wait: bool = True) -> None:
        """Queue puts that another part of the server has received, in their order.
        `wait`: hold the caller back for a moment while a queue of theirs presses."""
        accepted = [put for put in puts if self._is_small_enough(put)]
        with self._lock:
            lost = [each for put in accepted for each in self._queues.add(put)]
            self._lock.notify_all()
        if lost:
            self._count_lost(lost)
        if wait:
            self._hold_back({put.authority for put in accepted})

    def _is_small_enough(self, put: Put) -> bool:
        if put.size <= self._limits.message_bytes:
            return True
        self._refuse("", put.authority, 1, self._limits.exceeded("message_bytes", put.size))
        put.done(False)
        return False

    def _hold_back(self, authorities: set[str]) -> None:
        """Wait while one of the queues presses; not for long, as others wait behind it."""
        until_s = time.monotonic() + _HOLD_BACK_S
        with self._lock:
            while not self._closing and time.monotonic() < until_s:
                if not any(self._queues.is_full_for(each, _PRESSING) for each in authorities):
                    return
                self._lock.wait(_HOLD_BACK_S / 5)

    def authorities(self) -> set[str]:
        """Those that have published, of whose keys at most `_KNOWN_KEYS` are remembered."""
        return {source[0] for source in list(self._sources.values()) if source is not None}

    # --- the two threads

    def _receive_and_serve(self, handler: Any) -> None:
        try:
            while not self._closing:
                if self._may_receive():
                    self._receive(handler, handler.try_recv())
                with self._lock:
                    turn = self._queues.take(small_only=True)
                    self._idle = turn is None
                if turn is not None:
                    self._serve(turn)
                elif self._may_receive():
                    self._receive(handler, handler.recv())
                else:
                    with self._lock:
                        self._lock.wait(_HOLD_BACK_S / 5)
        except zenoh.ZError:  # undeclared
            return

    def _serve_large(self) -> None:
        while True:
            with self._lock:
                # Small puts that come after a large one of the same authority are left to this
                # thread if the other one waits for Zenoh.
                while not (
                    self._closing
                    or self._queues.has_large
                    or (self._idle and self._queues.has_small)
                ):
                    self._lock.wait()
                turn = None if self._closing else self._queues.take(small_only=False)
            if self._closing:
                return
            if turn is not None:
                self._serve(turn)

    # --- receiving

    def _may_receive(self) -> bool:
        """False while the receiver holds back, so that Zenoh holds the publisher back."""
        if not self._pressing:
            return True
        with self._lock:
            self._pressing = {
                each for each in self._pressing if self._queues.is_full_for(each, _PRESSING)
            }
            half_full = any(self._queues.is_full_for(each, 0.5) for each in self._pressing)
        # All puts come through one channel. While one publisher is held back, the others' puts
        # wait in it behind a few of its own; with several, for too long. So then the queues fill,
        # and drop.
        if len(self._pressing) != 1:
            return True
        now_s = time.monotonic()
        alone = self._is_alone(now_s)
        if alone and half_full:
            return False
        longest_s = _HOLD_BACK_ALONE_S if alone else _HOLD_BACK_S
        return self._served >= _CHANNEL or now_s - self._received_s >= longest_s

    def _is_alone(self, now_s: float) -> bool:
        return now_s - self._other_seen_s > _ALONE_S

    def _receive(self, handler: Any, sample: zenoh.Sample | None) -> None:
        """Sort a sample and those behind it into the queues."""
        if sample is None:
            return
        now_s = time.monotonic()
        # Late: while one authority presses, the others must not wait behind its puts.
        late = bool(self._pressing) and not self._is_alone(now_s)
        most_bytes = self._limits.put_queues_bytes if late else self._max_queue_bytes * _BATCH
        puts: list[Put] = []
        size = 0
        while True:
            put = self._put_of(sample)
            if put is not None:
                if put.authority != self._last_authority:
                    self._other_seen_s = now_s if puts else self._last_seen_s
                    self._last_authority = put.authority
                puts.append(put)
                size += put.size
            if size >= most_bytes or len(puts) >= _CHANNEL:
                break
            sample = handler.try_recv()
            if sample is None:
                break
        self._received_s = self._last_seen_s = now_s
        self._served = 0
        if not puts:
            return
        with self._lock:
            lost = [each for put in puts for each in self._queues.add(put)]
            for authority in {put.authority for put in puts}:
                if self._queues.is_full_for(authority, _PRESSING):
                    self._pressing.add(authority)
            if self._queues.has_large:
                self._lock.notify()
        if lost:
            self._count_lost(lost)

    def _put_of(self, sample: zenoh.Sample) -> Put | None:
        """The put of a sample; None if it is none, or is refused at once."""
        if sample.kind != zenoh.SampleKind.PUT:
            return None
        key = str(sample.key_expr)
        try:
            source = self._sources[key]
        except KeyError:
            source = self._source_of(key)
        if source is None:
            return None
        payload: Any = sample.payload
        size = len(payload)
        if size > self._limits.message_bytes:
            error = self._limits.exceeded("message_bytes", size)
            self._refuse(key, source[0], 1, error)
            return None
        if size <= LARGE_BYTES:  # a copy: Zenoh's own would keep the whole batch that it was in
            payload = payload.to_bytes()
        # Each at its own time: puts also arrive while those before them are sorted.
        return Put(source[0], source[1], payload, size, time.time_ns())

    def _source_of(self, key: str) -> tuple[str, bool] | None:
        """The authority of a key, and whether it is for static transforms. None: for neither."""
        kind = keys.put_kind(key)
        if kind is None:
            return None
        try:
            source = keys.last_name(key), kind == "static"
        except InvalidArgumentException as error:
            self._refuse(key, None, 1, error)
            return None
        self._sources[key] = source
        return source

    def _count_lost(self, lost: list[Put]) -> None:
        """Count and log puts that a queue had no room for."""
        dropped = Counter(put.authority for put in lost if not put.static)
        for authority, count in dropped.items():
            self._refusals.drop(authority, count)
            self._log.warn(
                f"puts of {quoted(authority)}",
                "its queue is full, so its oldest puts are dropped: it sends more than this "
                "server can commit beside the others",
            )
        for put in lost:
            if put.static:
                error = self._limits.exceeded("put_queue_bytes", put.size + self._max_queue_bytes)
                self._refuse("", put.authority, 1, error)
                put.done(False)
        with self._lock:
            self._counters.dropped_by_queue += dropped.total()

    # --- committing

    def _serve(self, turn: Turn) -> None:
        """Commit the puts of a turn. Never raises: an error is counted and logged."""
        counts = PutCounters()
        for place, put in enumerate(turn.puts):
            self._ingest(put, counts, measure=place == 0)
        if counts.puts:
            self._refusals.accept(turn.puts[0].authority)
        with self._lock:
            total = self._counters
            total.puts += counts.puts
            total.put_transforms += counts.put_transforms
            total.dropped_as_too_old += counts.dropped_as_too_old
            total.flagged_as_future += counts.flagged_as_future
            self._served += len(turn.puts)
            self._queues.done(turn)
            if self._queues.has_large:
                self._lock.notify()

    def _ingest(self, put: Put, counts: PutCounters, *, measure: bool) -> None:
        authority = put.authority
        transforms = 1  # a message that cannot be parsed counts as one transform
        try:
            commit = self._commit_of(put)
            transforms = len(commit.rows)
            self._limits.check("rows", len(commit.rows))
            # The key counts, not the message: Zenoh's access control has checked the key.
            commit.authority, commit.static = authority, put.static
            commit.drop_old = True
            commit.read_names, commit.read_versions = [], None
            max_stamp_ns = self._future.limit_ns(put.arrival_ns) if self._future.refuses else None
            stored = self._commit(commit, max_stamp_ns).tobytes()
        except Exception as error:
            if put.parts is not None:
                for part in put.parts(put):
                    self._ingest(part, counts, measure=False)
                return
            self._refuse("", authority, transforms, error)
            put.done(False)
            return
        put.done(True)
        kept = stored.count(1)
        counts.puts += 1
        counts.put_transforms += kept
        if kept != transforms:
            if not commit.announce:  # what an announcement leaves out is not old
                counts.dropped_as_too_old += stored.count(0)
            self._refuse_future(commit, stored)
        if put.static or not transforms:
            return
        if measure:
            self._clocks.put_arrived(authority, put.arrival_ns, commit.rows.newest_stamp)
        if self._future.flags:
            counts.flagged_as_future += self._flag_future(commit, put)

    def _commit_of(self, put: Put) -> wire.Commit:
        if type(put.payload) is TransformRows:
            return wire.Commit(put.payload)
        payload = put.payload if type(put.payload) is bytes else put.payload.to_bytes()
        if put.decode is None:
            return wire.parse_commit(self._limits.unpack(payload))
        return wire.Commit(put.decode(payload))

    def _refuse_future(self, commit: wire.Commit, stored: bytes) -> None:
        """Count and log the rows that were not stored because they are from the future."""
        rows = stored.count(2)
        if rows:
            reason = self._future.describe(commit, stored.index(2))
            self._refusals.refuse(commit.authority, rows, reason)
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)

    def _flag_future(self, commit: wire.Commit, put: Put) -> int:
        """Log the rows that are from the future; return how many there are."""
        rows = self._future.beyond(commit, self._future.limit_ns(put.arrival_ns))
        if rows:
            reason = self._future.describe(commit, rows[0])
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)
        return len(rows)

    def _refuse(self, key: str, authority: str | None, transforms: int, error: Exception) -> None:
        field = error.field if isinstance(error, TransformException) else None
        where = f" (field {field})" if field else ""
        reason = f"{type(error).__name__}: {error}{where}"
        if authority is not None:
            self._refusals.refuse(authority, transforms, reason)
        self._log.warn(f"put of {quoted(key if authority is None else authority)}", reason)
        with self._lock:  # last: a client that sees the count finds the reason as well
            self._counters.bad_puts += 1
