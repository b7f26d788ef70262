"""Remembered outcomes of writes: a write that is sent again gets the first outcome, and runs once.

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
from dataclasses import dataclass, field
from typing import Final

from zenoh_tf.errors import InvalidArgumentException, LimitExceeded, ServerBusy, TimeoutException

from ..fair_share import FairShare
from ..limits import Limits

#: What an outcome costs beside its bytes.
_OVERHEAD_BYTES: Final = 64
#: Repeats that may wait for one running write.
_MAX_REPEATS: Final = 64
_RETRY_AFTER_S: Final = 0.1
_NS: Final = 1_000_000_000
#: Most time until a write's expiry.
_MAX_EXPIRY_S: Final = 600


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
    waiting: list[OnRepeat] = field(default_factory=list)  # repeats of a running write


class ReplyCache:
    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._entries: dict[bytes, _Entry] = {}
        self._finished: list[tuple[int, bytes]] = []  # a heap of expiries; running writes are not
        self._count = FairShare(limits, "outcomes")
        self._bytes = FairShare(limits, "outcome_bytes")

    def __len__(self) -> int:
        return len(self._entries)

    def begin(
        self,
        request_id: bytes,
        client: str,
        what: str,
        expires_ns: int | None,
        reserve: int,
        on_repeat: OnRepeat,
    ) -> int | None:
        """Return the write's expiry: the caller must run it before then, and call `finish`. None:
        this is a repeat, and `on_repeat` gets the first outcome, now or when the write ends.
        `what`: the kind of write; a repeat is of the same kind, or its sender reuses an id.

        Raises:
            InvalidArgumentException: The id is that of a write of another kind.
            TimeoutException: The expiry has passed.
            LimitExceeded: The expiry is too far ahead.
            ServerBusy: The client's share is used up, or too many repeats wait for the write.
        """
        with self._lock:
            entry = self._entries.get(request_id)
            if entry is None:
                return self._begin(request_id, client, what, expires_ns, reserve)
            if entry.what != what:
                raise InvalidArgumentException(
                    f"the id is that of another write, {entry.what}: this one, {what}, did not run",
                    field="id",
                )
            if entry.outcome is None:
                if len(entry.waiting) >= _MAX_REPEATS:
                    raise ServerBusy(
                        "the write runs, and too many repeats of it wait for its outcome",
                        retry_after_s=_RETRY_AFTER_S,
                    )
                entry.waiting.append(on_repeat)
                return None
        on_repeat(entry.outcome, entry.failed)
        return None

    def finish(self, request_id: bytes, outcome: bytes, failed: bool) -> None:
        """Remember the outcome of a write, and hand it to the repeats that came while it ran."""
        with self._lock:
            entry = self._entries[request_id]
            entry.outcome, entry.failed = outcome, failed
            waiting, entry.waiting = entry.waiting, []
            size = _OVERHEAD_BYTES + len(outcome)
            self._bytes.take(entry.client, size - entry.size)
            entry.size = size
            heapq.heappush(self._finished, (entry.until_ns, request_id))
        for on_repeat in waiting:
            on_repeat(outcome, failed)

    def expiry(self, expires_ns: int | None) -> int:
        """Return the time by which a write must have run, from the one that its message names.

        Raises:
            TimeoutException: It has passed.
            LimitExceeded: It is too far ahead.
        """
        return self._expiry(expires_ns, time.monotonic_ns())

    def _expiry(self, expires_ns: int | None, now_ns: int) -> int:
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
        if expires_ns > now_ns + _MAX_EXPIRY_S * _NS:
            ahead_s = (expires_ns - now_ns) // _NS
            raise LimitExceeded(
                f"{ahead_s} seconds until the write's expiry: the limit is {_MAX_EXPIRY_S}",
                field="expiry_s",
                limit=_MAX_EXPIRY_S,
                value=ahead_s,
            )
        return expires_ns

    def _begin(
        self, request_id: bytes, client: str, what: str, expires_ns: int | None, reserve: int
    ) -> int:
        now_ns = time.monotonic_ns()
        until_ns = self._expiry(expires_ns, now_ns)
        self._forget_expired(now_ns)
        size = _OVERHEAD_BYTES + reserve
        if not self._count.admit(client, 1):
            raise self._count.refusal(client, 1, self._retry_after_s(now_ns))
        if not self._bytes.admit(client, size):
            self._count.give_back(client, 1)
            raise self._bytes.refusal(client, size, self._retry_after_s(now_ns))
        self._entries[request_id] = _Entry(client, what, until_ns, size)
        return until_ns

    def _retry_after_s(self, now_ns: int) -> float:
        """When the next outcome is forgotten."""
        if not self._finished:
            return _RETRY_AFTER_S
        return max(_RETRY_AFTER_S, (self._finished[0][0] - now_ns) / _NS)

    def _forget_expired(self, now_ns: int) -> None:
        while self._finished and self._finished[0][0] < now_ns:
            _, request_id = heapq.heappop(self._finished)
            entry = self._entries.pop(request_id)
            self._count.give_back(entry.client, 1)
            self._bytes.give_back(entry.client, entry.size)
