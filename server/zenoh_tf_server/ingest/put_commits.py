"""Commits puts: each at one instant, and a refused one harms no other.

Of a put every good row is stored, as tf2 does; the others are counted by reason, and named.

The messages are decoded in one native call and committed in another, without the
interpreter lock. Python sees what became of each put.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import zenoh

from zenoh_tf import admission, wire
from zenoh_tf._core import TransformRows, decode_puts
from zenoh_tf.text import quoted

from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from .clock_offsets import ClockOffsets
from .future_stamps import FutureStamps
from .put_queues import Put
from .refusals import Refusals

#: What became of a put. None: all rows are stored. Bytes: what became of each row
#: (zenoh_tf/admission.py), if none is refused. Refused: the same, and why. Else why none is stored.
Outcome: TypeAlias = bytes | admission.Refused | Exception | None


@dataclass(slots=True)
class PutCounters:
    """Counters of all published messages, part of `stats`."""

    puts: int = 0
    put_transforms: int = 0
    bad_puts: int = 0
    dropped_as_too_old: int = 0
    dropped_by_queue: int = 0  # messages
    dropped_as_stale: int = 0  # those of them that had waited for too long
    flagged_as_future: int = 0  # transforms stored although they are beyond --max-future-s


class PutCommits:
    """Commits puts, and counts and logs what is refused or dropped."""

    def __init__(
        self,
        commit: Callable[[Sequence[wire.Commit]], list[Outcome]],
        counters: PutCounters,
        refusals: Refusals,
        limits: Limits,
        clocks: ClockOffsets,
        future: FutureStamps,
    ) -> None:
        """`commit`: commits to the tree, in this order, each as a transaction of its own, as
        `Service.commit_puts` does."""
        self._commit = commit
        self._counters = counters
        self._refusals = refusals
        self._limits = limits
        self._clocks = clocks
        self._future = future
        self._flags_future = future.flags
        #: How far a stamp may be ahead of its put's arrival; None: as far as it likes.
        self._max_future_ns = round(future.max_future_s * 1e9) if future.refuses else None
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ingest"))
        self._lock = threading.Lock()  # of the counters

    def run(self, puts: list[Put]) -> None:
        """Commit puts in their order. Never raises: an error is counted and logged."""
        decoded = self._decode(puts)
        outcomes = iter(self._commit([each for each in decoded if type(each) is wire.Commit]))
        stored_puts = stored_rows = old_rows = flagged_rows = bad_puts = 0
        measured = ""
        for put, commit in zip(puts, decoded, strict=True):
            if isinstance(commit, RefusedPut):
                self.refuse_put(put, commit.transforms, commit.error)
                continue
            outcome = next(outcomes)
            if outcome is None:
                stored_rows += len(commit.rows)
            elif isinstance(outcome, Exception):
                self.refuse_put(put, len(commit.rows), outcome)
                continue
            else:
                rows, old = self._count_rows(commit, outcome)
                stored_rows += rows
                old_rows += old
                if isinstance(outcome, admission.Refused) and not rows:
                    bad_puts += 1
                    if put.done is not None:
                        put.done(False)
                    continue
            if put.done is not None:
                put.done(True)
            stored_puts += 1
            if put.authority not in self._refusals.accepted:
                self._refusals.accept(put.authority)
            if put.static or not len(commit.rows):
                continue
            if put.authority != measured:  # one of those that came together suffices
                measured = put.authority
                self._clocks.put_arrived(measured, put.arrival_ns, commit.rows.newest_stamp)
            if self._flags_future:
                flagged_rows += self._flag_future(commit, put)
        with self._lock:
            counters = self._counters
            counters.puts += stored_puts
            counters.put_transforms += stored_rows
            counters.dropped_as_too_old += old_rows
            counters.flagged_as_future += flagged_rows
            counters.bad_puts += bad_puts

    def refuse(self, key: str, authority: str | None, transforms: int, error: Exception) -> None:
        """Count and log a refused put. `authority`: None if the key has none."""
        reason = admission.described(error)
        if authority is not None:
            self._refusals.refuse(authority, {admission.MESSAGE: transforms}, reason)
        self._log.warn(f"put of {quoted(key if authority is None else authority)}", reason)
        with self._lock:  # last: a client that sees the count finds the reason as well
            self._counters.bad_puts += 1

    def refuse_put(self, put: Put, transforms: int, error: Exception) -> None:
        """Count and log a put of which nothing is stored, and report it to its sender."""
        self.refuse("", put.authority, transforms, error)
        if put.done is not None:
            put.done(False)

    def count_lost(self, lost: Iterable[Put]) -> None:
        """Count and log puts that a queue had no room for."""
        self._count_dropped(
            [put for put in lost if not put.static],
            "its queue is full, so its oldest puts are dropped: it sends more than this server "
            "can commit beside the others",
        )
        for put in lost:
            if put.static:
                most = self._limits.put_queue_bytes
                error = self._limits.exceeded("put_queue_bytes", put.size + most)
                self.refuse_put(put, 1, error)

    def count_stale(self, stale: list[Put]) -> None:
        """Count and log puts that waited for too long."""
        self._count_dropped(
            stale,
            f"puts that waited for more than {self._limits.put_wait_ms} ms (--limit put_wait_ms=N) "
            "are dropped, as newer ones wait behind them: this server gets more than it can commit",
        )
        with self._lock:
            self._counters.dropped_as_stale += len(stale)

    def _count_dropped(self, puts: list[Put], reason: str) -> None:
        for authority, count in Counter(put.authority for put in puts).items():
            self._refusals.drop(authority, count)
            self._log.warn(f"puts of {quoted(authority)}", reason)
        with self._lock:
            self._counters.dropped_by_queue += len(puts)

    # --- committing

    def _decode(self, puts: list[Put]) -> list[wire.Commit | RefusedPut]:
        """The transaction of each put, or why there is none."""
        messages: list[bytes | None] = []  # those of this project's protocol
        for put in puts:
            if type(put.payload) is zenoh.ZBytes:
                put.payload = put.payload.to_bytes()
            is_message = type(put.payload) is bytes and put.decode is None
            messages.append(put.payload if is_message else None)
        limits, max_future_ns = self._limits, self._max_future_ns
        decoded: list[wire.Commit | RefusedPut] = []
        rows = decode_puts(messages, limits.rows, limits.decoded_bytes)
        for put, plain in zip(puts, rows, strict=True):
            commit = wire.Commit(plain) if plain is not None else self._commit_of(put)
            if type(commit) is wire.Commit:
                # The key counts, not the message: Zenoh's access control has checked the key.
                commit.authority, commit.static = put.authority, put.static
                commit.drop_old = commit.drop_bad = True
                commit.drop_strays = not put.is_relayed
                if max_future_ns is not None:
                    commit.max_stamp_ns = put.arrival_ns + max_future_ns
            decoded.append(commit)
        return decoded

    def _commit_of(self, put: Put) -> wire.Commit | RefusedPut:
        """The transaction of a put that is no plain message, or why there is none."""
        transforms = 1  # a message that cannot be parsed counts as one transform
        try:
            if type(put.payload) is TransformRows:
                commit = wire.Commit(put.payload)
            elif put.decode is not None:
                commit = wire.Commit(put.decode(put.payload))
            else:
                commit = wire.parse_commit(self._limits.unpack(put.payload))
                commit.read_names, commit.read_versions = [], None
            transforms = len(commit.rows)
            self._limits.check("rows", transforms)
            self._limits.check_names(commit.rows.name_count)
        except Exception as error:
            return RefusedPut(error, transforms)
        return commit

    def _count_rows(
        self, commit: wire.Commit, outcome: bytes | admission.Refused
    ) -> tuple[int, int]:
        """Count and log the rows of a put that are not stored. Returns how many are stored, and how
        many are dropped as too old."""
        refused = outcome if isinstance(outcome, admission.Refused) else None
        stored = outcome if isinstance(outcome, bytes) else outcome.stored
        future = stored.count(admission.FROM_FUTURE)
        if future:
            reason = self._future.describe(commit, stored.index(admission.FROM_FUTURE))
            by_reason = {admission.REASONS[admission.FROM_FUTURE]: future}
            self._refusals.refuse(commit.authority, by_reason, reason)
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)
        if refused is not None:
            sender = quoted(commit.authority)
            for error in refused.errors:
                self._log.warn(
                    f"put of {sender}: frame {quoted(error.frame or '')}",
                    admission.described(error),
                )
            self._refusals.refuse(commit.authority, refused.by_reason, refused.reason)
        # What an announcement leaves out is not old.
        old = 0 if commit.announce else stored.count(admission.TOO_OLD)
        return stored.count(admission.STORED), old

    def _flag_future(self, commit: wire.Commit, put: Put) -> int:
        """Log the rows that are from the future; return how many there are."""
        rows = self._future.beyond(commit, self._future.limit_ns(put.arrival_ns))
        if rows:
            reason = self._future.describe(commit, rows[0])
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)
        return len(rows)


@dataclass(slots=True)
class RefusedPut:
    """Why a put has no transaction, and how many transforms it counts as."""

    error: Exception
    transforms: int
