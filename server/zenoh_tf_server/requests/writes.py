"""Writes that run at most once, before their expiry, and only on the instance they are meant for.

A write that is sent again gets the first outcome. One without an id is not remembered: it runs each
time that it comes.

Thread safety: all methods.
Invariant: an outcome is kept until the write's expiry, after which a repeat is refused as expired,
so no write ever runs twice. The clock is read under the lock that guards the outcomes, so nothing
can come between the two. If a client's share is used up, its new writes are refused; an
unexpired outcome is never forgotten.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from zenoh_tf import wire
from zenoh_tf.errors import (
    InvalidArgumentException,
    LimitExceeded,
    ServerBusy,
    ServerRestarted,
    TimeoutException,
)
from zenoh_tf.text import quoted

from ..fair_share import FairShare
from ..limits import Limits
from .handler import ReplyCallback

#: What an outcome costs beside its bytes.
_OVERHEAD_BYTES: Final = 64
#: Repeats that may wait for one running write.
_MAX_REPEATS: Final = 64
_RETRY_AFTER_S: Final = 0.1
_NS: Final = 1_000_000_000
#: Most time until a write's expiry.
_MAX_EXPIRY_S: Final = 600
_MAX_EXPIRY_NS: Final = _MAX_EXPIRY_S * _NS
#: Outcomes are forgotten in the period after the one of their expiry.
_PERIOD_NS: Final = _NS // 8
#: A write forgets up to this many expired outcomes: more than it adds, and no long work for one.
_FORGET_AT_ONCE: Final = 4

#: Runs a write that expires at the given time of the server's clock. Returns the bytes of its reply
#: and what to remember of it: all or a part.
Run = Callable[[int], tuple[bytes, bytes]]
#: Makes the reply to a repeat from what is remembered.
Repeat = Callable[[bytes], bytes]
#: Called with the outcome of a write that was repeated; True: it is an error.
OnRepeat = Callable[[bytes, bool], None]


@dataclass(slots=True)
class _Entry:
    client: str
    what: str  # the write is
    until_ns: int
    size: int  # that count against the limit: first those reserved, then those of the outcome
    outcome: bytes | None = None  # None while the write runs
    failed: bool = False
    waiting: tuple[OnRepeat, ...] = ()  # repeats of a running write


class WriteOutcomes:
    """Decides which writes run, and remembers their outcomes; see the module."""

    def __init__(self, instance: str, limits: Limits) -> None:
        self._instance = instance
        self._limits = limits
        self._lock = threading.Lock()
        self._entries: dict[bytes, _Entry] = {}
        #: The ids of finished writes by the period in which they are forgotten. A heap of all
        #: expiries would have 15,000 entries for a client that writes without a pause.
        self._finished: dict[int, list[bytes]] = {}
        self._periods: list[int] = []  # a heap
        self._count = FairShare(limits, "outcomes")
        self._bytes = FairShare(limits, "outcome_bytes")

    def __len__(self) -> int:
        """How many outcomes are remembered."""
        return len(self._entries)

    def run(
        self,
        message: wire.Message,
        reply_to: ReplyCallback,
        error_reply: Callable[[Exception], bytes],
        what: str,
        run: Run,
        repeat: Repeat = lambda outcome: outcome,
        reserve: int = 0,
    ) -> None:
        """Run a write and reply, or reply with its outcome if this is a repeat.
        `error_reply` makes the reply of a write that fails. `what`: the kind of write; a repeat is
        of the same kind, or its sender reuses an id. `reserve`: bytes that its outcome may have,
        where that is much.

        Raises:
            ServerRestarted: It is meant for another instance.
            TimeoutException: Its expiry has passed.
            LimitExceeded: Its expiry is too far ahead.
            InvalidArgumentException: Its id is that of a write of another kind.
            ServerBusy: Too much is remembered for its client, or too many repeats wait for it.
        """
        write = wire.parse_write(message)
        if write.instance is not None and write.instance != self._instance:
            raise ServerRestarted(
                f"the write is for server instance {quoted(write.instance)}, but this is instance "
                f"{self._instance}: it did not run; send it again, or run its transaction again",
                value=write.instance,
            )
        if write.id is None:
            reply_to(run(self._expiry(write.expires_ns, time.monotonic_ns()))[0], False)
            return

        with self._lock:
            entry = self._entries.get(write.id)
            if entry is None:
                now_ns = time.monotonic_ns()
                expires_ns = write.expires_ns or 0
                if not now_ns <= expires_ns <= now_ns + _MAX_EXPIRY_NS:
                    expires_ns = self._expiry(write.expires_ns, now_ns)
                size = _OVERHEAD_BYTES + reserve
                self._take_share(reply_to.client, size, now_ns)
                self._entries[write.id] = _Entry(reply_to.client, what, expires_ns, size)
        if entry is not None:
            self._repeat(entry, reply_to, error_reply, what, repeat)
            return
        failed = False
        try:
            reply, outcome = run(expires_ns)
        except Exception as error:
            reply = outcome = error_reply(error)
            failed = True
        self._finish(write.id, outcome, failed)
        reply_to(reply, failed)

    def _repeat(
        self,
        entry: _Entry,
        reply_to: ReplyCallback,
        error_reply: Callable[[Exception], bytes],
        what: str,
        repeat: Repeat,
    ) -> None:
        """Reply with the outcome of the first write of that id, now or when it ends."""

        def on_repeat(outcome: bytes, failed: bool) -> None:
            try:
                reply = outcome if failed else repeat(outcome)
            except Exception as error:  # of the reads in the repeat
                reply, failed = error_reply(error), True
            reply_to(reply, failed)

        if entry.what != what:
            raise InvalidArgumentException(
                f"the id is that of another write, {entry.what}: this one, {what}, did not run",
                field="id",
            )
        with self._lock:
            if entry.outcome is None:
                if len(entry.waiting) >= _MAX_REPEATS:
                    raise ServerBusy(
                        "the write runs, and too many repeats of it wait for its outcome",
                        retry_after_s=_RETRY_AFTER_S,
                    )
                entry.waiting += (on_repeat,)
                return
        on_repeat(entry.outcome, entry.failed)

    def _finish(self, request_id: bytes, outcome: bytes, failed: bool) -> None:
        """Remember the outcome of a write, and hand it to the repeats that came while it ran."""
        with self._lock:
            entry = self._entries[request_id]
            entry.outcome, entry.failed = outcome, failed
            waiting, entry.waiting = entry.waiting, ()
            size = _OVERHEAD_BYTES + len(outcome)
            self._bytes.take_unchecked(entry.client, size - entry.size)
            entry.size = size
            period = entry.until_ns // _PERIOD_NS + 1
            ids = self._finished.get(period)
            if ids is None:
                ids = self._finished[period] = []
                heapq.heappush(self._periods, period)
            ids.append(request_id)
        for on_repeat in waiting:
            on_repeat(outcome, failed)

    def _expiry(self, expires_ns: int | None, now_ns: int) -> int:
        """Return the time by which a write must have run, from the one that its message names."""
        if expires_ns is None:
            return now_ns + self._limits.default_expiry_s * _NS
        if expires_ns < now_ns:
            late_ms = (now_ns - expires_ns) / 1e6
            raise TimeoutException(
                f"the write's turn came {late_ms:.1f} ms after its expiry, and it did not run: "
                "send it again, with a longer timeout_s",
                field="expires_ns",
                value=expires_ns,
            )
        if expires_ns > now_ns + _MAX_EXPIRY_NS:
            ahead_s = (expires_ns - now_ns) // _NS
            raise LimitExceeded(
                f"{ahead_s} seconds until the write's expiry: the limit is {_MAX_EXPIRY_S}",
                field="expiry_s",
                limit=_MAX_EXPIRY_S,
                value=ahead_s,
            )
        return expires_ns

    def _take_share(self, client: str, size: int, now_ns: int) -> None:
        """Count one more outcome of a client. Requires the lock."""
        if self._periods and self._periods[0] * _PERIOD_NS < now_ns:
            self._forget_expired(now_ns, _FORGET_AT_ONCE)
        if self._count.try_take(client, 1):
            if self._bytes.try_take(client, size):
                return
            self._count.give_back(client, 1)
        if self._forget_expired(now_ns, len(self._entries)):  # which may make room
            self._take_share(client, size, now_ns)
            return
        retry_after_s = _RETRY_AFTER_S  # when the next outcomes are forgotten
        if self._periods:
            retry_after_s = max(retry_after_s, (self._periods[0] * _PERIOD_NS - now_ns) / _NS)
        self._count.require_room(client, 1, retry_after_s)
        raise self._bytes.refusal(client, size, retry_after_s)

    def _forget_expired(self, now_ns: int, at_most: int) -> int:
        """Forget outcomes whose writes have expired. Returns how many. Requires the lock."""
        forgotten = 0
        while self._periods and self._periods[0] * _PERIOD_NS < now_ns and forgotten < at_most:
            ids = self._finished[self._periods[0]]
            entry = self._entries.pop(ids.pop())
            self._count.give_back(entry.client, 1)
            self._bytes.give_back(entry.client, entry.size)
            forgotten += 1
            if not ids:
                del self._finished[heapq.heappop(self._periods)]
        return forgotten
