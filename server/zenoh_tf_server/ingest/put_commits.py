"""Commits the puts of a turn: each at one instant, and a refused one harms no other.

Of a put every good row is stored, as tf2 does; the others are counted by reason, and named.

The messages of a turn are decoded in one native call and committed in another, without the
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

from zenoh_tf import admission, wire
from zenoh_tf._core import TransformRows, decode_puts
from zenoh_tf.text import quoted

from ..limits import Limits
from ..rate_limited_log import RateLimitedLog
from .clock_offsets import ClockOffsets
from .future_stamps import FutureStamps
from .put_queues import Put, Turn
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
        self._log = RateLimitedLog(logging.getLogger("zenoh_tf.server.ingest"))
        self._lock = threading.Lock()  # of the counters

    def run(self, turns: list[Turn]) -> None:
        """Commit the puts of turns. Never raises: an error is counted and logged."""
        counts = PutCounters()
        commits = self._run([put for turn in turns for put in turn.puts], counts)
        at = 0
        for turn in turns:
            self._measure(turn, commits[at])
            at += len(turn.puts)
        with self._lock:
            total = self._counters
            total.puts += counts.puts
            total.put_transforms += counts.put_transforms
            total.dropped_as_too_old += counts.dropped_as_too_old
            total.flagged_as_future += counts.flagged_as_future

    def _measure(self, turn: Turn, first: wire.Commit | None) -> None:
        """Follow the clock of a turn's authority by its first put."""
        if first is not None and not first.static and len(first.rows):
            arrival_ns = turn.puts[0].arrival_ns
            self._clocks.put_arrived(first.authority, arrival_ns, first.rows.newest_stamp)

    def refuse(self, key: str, authority: str | None, transforms: int, error: Exception) -> None:
        """Count and log a refused put. `authority`: None if the key has none."""
        reason = admission.described(error)
        if authority is not None:
            self._refusals.refuse(authority, {admission.MESSAGE: transforms}, reason)
        self._log.warn(f"put of {quoted(key if authority is None else authority)}", reason)
        with self._lock:  # last: a client that sees the count finds the reason as well
            self._counters.bad_puts += 1

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
                self.refuse("", put.authority, 1, error)
                put.done(False)

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

    def _run(self, puts: list[Put], counts: PutCounters) -> list[wire.Commit | None]:
        """Commit puts. Returns the transaction of each; None if it was refused."""
        decoded = self._decode(puts)
        outcomes = iter(self._commit([each for each in decoded if type(each) is wire.Commit]))
        commits: list[wire.Commit | None] = []
        for put, commit in zip(puts, decoded, strict=True):
            if isinstance(commit, _Refused):
                self._settle_refused(put, commit)
                commits.append(None)
                continue
            outcome = next(outcomes)
            if isinstance(outcome, Exception):
                self._settle_refused(put, _Refused(outcome, len(commit.rows)))
                commits.append(None)
                continue
            if outcome is not None and not self._count_rows(put, commit, outcome, counts):
                commits.append(None)
                continue
            commits.append(commit)
            put.done(True)
            self._refusals.accept(put.authority)
            counts.puts += 1
            if outcome is None:
                counts.put_transforms += len(commit.rows)
            if self._future.flags and not put.static:
                counts.flagged_as_future += self._flag_future(commit, put)
        return commits

    def _decode(self, puts: list[Put]) -> list[wire.Commit | _Refused]:
        """The transaction of each put, or why there is none."""
        limits, refuses_future = self._limits, self._future.refuses
        rows = decode_puts([put.message() for put in puts], limits.rows, limits.decoded_bytes)
        decoded: list[wire.Commit | _Refused] = []
        for put, plain in zip(puts, rows, strict=True):
            commit = wire.Commit(plain) if plain is not None else self._commit_of(put)
            if type(commit) is wire.Commit:
                # The key counts, not the message: Zenoh's access control has checked the key.
                commit.authority, commit.static = put.authority, put.static
                commit.drop_old = commit.drop_bad = True
                commit.drop_strays = not put.is_relayed
                if refuses_future:
                    commit.max_stamp_ns = self._future.limit_ns(put.arrival_ns)
            decoded.append(commit)
        return decoded

    def _commit_of(self, put: Put) -> wire.Commit | _Refused:
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
            return _Refused(error, transforms)
        return commit

    def _settle_refused(self, put: Put, refused: _Refused) -> None:
        self.refuse("", put.authority, refused.transforms, refused.error)
        put.done(False)

    def _count_rows(
        self,
        put: Put,
        commit: wire.Commit,
        outcome: bytes | admission.Refused,
        counts: PutCounters,
    ) -> bool:
        """Count the rows of a put of which some are not stored. Returns False if the put is
        refused: a row of it is, and none is stored."""
        refused = outcome if isinstance(outcome, admission.Refused) else None
        stored = outcome if isinstance(outcome, bytes) else outcome.stored
        rows = stored.count(admission.STORED)
        counts.put_transforms += rows
        if not commit.announce:  # what an announcement leaves out is not old
            counts.dropped_as_too_old += stored.count(admission.TOO_OLD)
        future = stored.count(admission.FROM_FUTURE)
        if future:
            reason = self._future.describe(commit, stored.index(admission.FROM_FUTURE))
            by_reason = {admission.REASONS[admission.FROM_FUTURE]: future}
            self._refusals.refuse(commit.authority, by_reason, reason)
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)
        if refused is None:
            return True
        sender = quoted(commit.authority)
        for error in refused.errors:
            self._log.warn(
                f"put of {sender}: frame {quoted(error.frame or '')}", admission.described(error)
            )
        self._refusals.refuse(commit.authority, refused.by_reason, refused.reason)
        if rows:
            return True
        put.done(False)
        with self._lock:
            self._counters.bad_puts += 1
        return False

    def _flag_future(self, commit: wire.Commit, put: Put) -> int:
        """Log the rows that are from the future; return how many there are."""
        rows = self._future.beyond(commit, self._future.limit_ns(put.arrival_ns))
        if rows:
            reason = self._future.describe(commit, rows[0])
            self._log.warn(f"put of {quoted(commit.authority)}: from the future", reason)
        return len(rows)


@dataclass(slots=True)
class _Refused:
    """Why a put has no transaction, and how many transforms it counts as."""

    error: Exception
    transforms: int
