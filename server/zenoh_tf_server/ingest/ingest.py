"""Ingest of published transforms: each put is one transaction, and a bad one harms no other.

One thread receives the puts from Zenoh. It commits small ones at once while nothing waits; else it
sorts them into a queue per authority (`put_queues`), and commits those whose turn it is. A second
thread commits the large ones, so that nobody waits for them.
docs/explanation/decisions/0009-puts-queue-per-authority.md has the reasons and the figures.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from zenoh_tf import threads
from zenoh_tf._net import keys
from zenoh_tf.bounded_map import BoundedMap
from zenoh_tf.errors import InvalidArgumentException

from ..limits import Limits
from .put_commits import PutCommits
from .put_queues import LARGE_BYTES, PUT_COST, Put, PutQueues, Turn

#: Puts between Zenoh's receiver and the ingest thread, which empties it after every turn.
_CHANNEL: Final = 64
#: Turns that are committed at once end after this cost: about 100 puts of 60 transforms.
_BATCH_COST: Final = 1 << 20
#: A queue that is filled above this part of its limits, or whose puts wait for this part of theirs,
#: presses: the receiver holds back.
_PRESSING: Final = 0.25
#: The receiver accepts no more at once than this part of a queue's limit, unless the puts of others
#: wait behind those of an authority that presses.
_BATCH: Final = 0.125
#: While a queue presses, the puts of others are received from Zenoh at least this often.
_HOLD_BACK_S: Final = 0.025
#: The same while it is alone, and there is room.
_HOLD_BACK_ALONE_S: Final = 0.1
#: An authority is alone after no other one has sent for this long.
_ALONE_S: Final = 1.0
#: While this many authorities send this many puts a second in all, the receiver waits for this time
#: after the first put of a turn, and commits with it what has come: a turn costs as much as two
#: puts. Fewer authorities gain little, and one of them could delay the data of the others.
_CROWD: Final = 8
_GATHER_ABOVE_HZ: Final = 800
_GATHER_S: Final = 0.001
#: Keys whose authority is remembered.
_KNOWN_KEYS: Final = 4096


class Ingest:
    """Receives the puts on ``set/*`` and ``static/*`` of a tree, and lets them be committed."""

    def __init__(self, commits: PutCommits, limits: Limits) -> None:
        self._commits = commits
        self._limits = limits
        self._max_queue_bytes = limits.put_queue_bytes
        self._lock = threading.Condition()  # of the queues
        self._queues = PutQueues(
            limits.put_queue_bytes, limits.put_queues_bytes, max_wait_s=limits.put_wait_ms * 1e-3
        )
        self._sources = BoundedMap[str, tuple[str, bool] | None](_KNOWN_KEYS)  # by key
        self._subscriber: zenoh.Subscriber[Any] | None = None
        self._threads: list[threading.Thread] = []
        self._closing = False
        #: The receiving thread has found nothing to commit since it has queued something last.
        self._idle = True
        # The receiver's: only its thread uses them.
        self._pressing: set[str] = set()
        self._last_authority = ""
        self._last_seen_s = self._other_seen_s = -_ALONE_S
        self._received_s = 0.0
        self._served = 0  # puts since the receiver took some last
        self._gathers = False
        self._counted, self._counted_s = 0, 0.0  # puts since then, for their rate
        self._senders: set[str] = set()  # the authorities of these

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
            lost = self._queue(accepted, time.monotonic())
            self._lock.notify_all()
        if lost:
            self._commits.count_lost(lost)
        if wait:
            self._hold_back({put.authority for put in accepted})

    def _is_small_enough(self, put: Put) -> bool:
        if put.size <= self._limits.message_bytes:
            return True
        error = self._limits.exceeded("message_bytes", put.size)
        self._commits.refuse_put(put, 1, error)
        return False

    def _queue(self, puts: list[Put], now_s: float) -> list[Put]:
        """Queue puts, under the lock. Returns those that were lost for them."""
        lost: list[Put] = []
        for put in puts:
            put.queued_s = now_s
            lost += self._queues.add(put)
        return lost

    def _hold_back(self, authorities: set[str]) -> None:
        """Wait while one of the queues presses; not for long, as others wait behind it."""
        until_s = time.monotonic() + _HOLD_BACK_S
        with self._lock:
            while not self._closing and time.monotonic() < until_s:
                if not any(self._is_pressing(each) for each in authorities):
                    return
                self._lock.wait(_HOLD_BACK_S / 5)

    def authorities(self) -> set[str]:
        """Those that have published, of whose keys at most `_KNOWN_KEYS` are remembered."""
        return {source[0] for source in list(self._sources.values()) if source is not None}

    # --- the two threads

    def _receive_and_serve(self, handler: Any) -> None:
        try:
            received = 0  # puts that are queued since this thread has committed some
            while not self._closing:
                if self._may_receive():
                    # Nothing else is to be done: this thread has queued nothing, and what others
                    # add the other thread commits.
                    sample = handler.recv() if self._idle else handler.try_recv()
                    if sample is not None:
                        received += self._receive(handler, sample)
                elif self._idle:
                    with self._lock:
                        self._lock.wait(_HOLD_BACK_S / 5)
                if self._idle:
                    continue
                # As many as have come: else a receiver that gets little time would drop most.
                while (served := self._serve_small()) and served < received:
                    received -= served
                received = 0
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
                turn = None if self._closing else self._take(small_only=False)
            if self._closing:
                return
            if turn is not None:
                self._serve([turn])

    def _serve_small(self) -> int:
        """Commit the small puts that are next, in a turn of each queue at most. Returns how many
        they are."""
        turns: list[Turn] = []
        cost = 0
        with self._lock:
            while cost < _BATCH_COST and (turn := self._take(small_only=True)) is not None:
                turns.append(turn)
                cost += turn.cost
            self._idle = not turns
        return self._serve(turns)

    def _take(self, *, small_only: bool) -> Turn | None:
        """The next turn, under the lock."""
        return self._queues.take(small_only=small_only, now_s=time.monotonic())

    def _serve(self, turns: list[Turn]) -> int:
        """Commit the puts of turns. Returns how many they are. Never raises."""
        puts = [put for turn in turns for put in turn.puts]
        if puts:
            self._commits.run(puts)
        with self._lock:
            self._served += len(puts)
            for turn in turns:
                self._queues.done(turn)
            stale = self._queues.take_dropped()
            if self._queues.has_large:
                self._lock.notify()
        if stale:
            self._commits.count_stale(stale)
        return len(puts)

    # --- receiving

    def _may_receive(self) -> bool:
        """False while the receiver holds back, so that Zenoh holds the publisher back."""
        if not self._pressing:
            return True
        pressing: list[str] = []
        with self._lock:
            for each in list(self._pressing):
                if not self._is_pressing(each):
                    self._pressing.discard(each)
                elif len(pressing := [*pressing, each]) > 1:
                    break
            half_full = any(self._is_pressing(each, 0.5) for each in pressing)
        # All puts come through one channel. While one publisher is held back, the others' puts
        # wait in it behind a few of its own; with several, for too long. So then the queues fill,
        # and drop.
        if len(pressing) != 1:
            return True
        now_s = time.monotonic()
        alone = self._is_alone(now_s)
        if alone and half_full:
            return False
        longest_s = _HOLD_BACK_ALONE_S if alone else _HOLD_BACK_S
        return self._served >= _CHANNEL or now_s - self._received_s >= longest_s

    def _is_pressing(self, authority: str, fraction: float = _PRESSING) -> bool:
        """True if the queue of an authority uses more than a fraction of its limits."""
        return self._queues.is_full_for(authority, fraction, time.monotonic())

    def _is_alone(self, now_s: float) -> bool:
        return now_s - self._other_seen_s > _ALONE_S

    def _receive(self, handler: Any, sample: zenoh.Sample | None) -> int:
        """Take a sample and those behind it. Their puts are committed at once if they meet no
        queue and need little time. Else they are queued: returns how many."""
        if self._gathers:
            time.sleep(_GATHER_S)
        now_s = time.monotonic()
        # While one authority presses, the others must not wait behind its puts.
        others_wait = bool(self._pressing) and not self._is_alone(now_s)
        limits = self._limits
        most_bytes = limits.put_queues_bytes if others_wait else self._max_queue_bytes * _BATCH
        puts: list[Put] = []
        size = largest = 0
        while sample is not None:
            put = self._put_of(sample)
            if put is not None:
                if put.authority != self._last_authority:
                    self._other_seen_s = now_s if puts else self._last_seen_s
                    self._last_authority = put.authority
                    self._senders.add(put.authority)
                puts.append(put)
                size += put.size
                largest = max(largest, put.size)
                if size >= most_bytes or len(puts) >= _CHANNEL:
                    break
            sample = handler.try_recv()
        self._received_s = self._last_seen_s = now_s
        self._served = 0
        self._counted += len(puts)
        if self._counted >= _CHANNEL:
            self._follow_rate(len(puts), now_s)
        if not puts:
            return 0
        # What this thread has queued counts until it is committed, so no put overtakes another.
        if (
            not self._queues.unfinished
            and largest <= LARGE_BYTES
            and size + len(puts) * PUT_COST <= _BATCH_COST
        ):
            self._commits.run(puts)
            return 0
        with self._lock:
            lost = self._queue(puts, now_s)
            self._idle = False
            self._pressing.update(
                each for each in {put.authority for put in puts} if self._is_pressing(each)
            )
            if self._queues.has_large:
                self._lock.notify()
        if lost:
            self._commits.count_lost(lost)
        return len(puts)

    def _follow_rate(self, received: int, now_s: float) -> None:
        """Decide whether to gather in the next turns. Not if the channel may fill meanwhile."""
        often = self._counted > _GATHER_ABOVE_HZ * (now_s - self._counted_s)
        is_crowd = len(self._senders) >= _CROWD
        self._gathers = often and is_crowd and received < _CHANNEL // 2
        self._counted, self._counted_s = 0, now_s
        self._senders.clear()

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
            self._commits.refuse(key, source[0], 1, error)
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
            self._commits.refuse(key, None, 1, error)
            return None
        self._sources[key] = source
        return source
