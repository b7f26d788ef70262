"""Remembered replies of writes: a write that is sent again gets the first reply, and runs once.

Thread safety: all methods.
Invariant: a reply is kept until the write's expiry, after which a repeat is refused as expired,
so no write ever runs twice. If the cache is full, a new write is refused; an unexpired reply is
never forgotten.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Protocol

from .limits import Limits


class ReplyCallback(Protocol):
    """Takes the reply to one request. Called exactly once."""

    @property
    def client(self) -> str:
        """The id of the client that sent the request; empty if it is not known."""

    def __call__(self, reply: bytes, failed: bool) -> None:
        """Send the reply's bytes; `failed`: they are an error."""


@dataclass(slots=True)
class _Entry:
    until_ns: int
    reply: bytes | None = None  # None while the write runs
    failed: bool = False
    waiting: list[ReplyCallback] = field(default_factory=list)  # repeats of a running write


class ReplyCache:
    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._entries: OrderedDict[bytes, _Entry] = OrderedDict()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._entries)

    def reply_to_repeat(self, request_id: bytes, reply_to: ReplyCallback) -> bool:
        """Reply with the first outcome, at once or when the write ends. False: not a repeat."""
        with self._lock:
            entry = self._entries.get(request_id)
            if entry is None:
                return False
            if entry.reply is None:
                entry.waiting.append(reply_to)
                return True
        reply_to(entry.reply, entry.failed)
        return True

    def begin(self, request_id: bytes, until_ns: int, now_ns: int, reply_to: ReplyCallback) -> bool:
        """True: the caller must run the write, then call `finish`. False: this is a repeat, and
        `reply_to` gets the first outcome.

        Raises:
            LimitExceeded: The cache is full.
        """
        while not self.reply_to_repeat(request_id, reply_to):
            with self._lock:
                self._forget_expired(now_ns)
                if request_id in self._entries:  # another thread began the same write meanwhile
                    continue
                self._limits.check("outcomes", len(self._entries) + 1)
                self._limits.check("outcome_bytes", self._bytes)
                self._entries[request_id] = _Entry(until_ns)
                return True
        return False

    def finish(self, request_id: bytes, reply: bytes, failed: bool) -> None:
        """Remember the outcome of a write, and reply to the repeats that came while it ran."""
        with self._lock:
            entry = self._entries[request_id]
            entry.reply, entry.failed = reply, failed
            waiting, entry.waiting = entry.waiting, []
            self._bytes += len(reply)
        for reply_to in waiting:
            reply_to(reply, failed)

    def _forget_expired(self, now_ns: int) -> None:
        """Forget expired entries, oldest first. Stops at the first one that is not expired, which
        may keep later ones for as long as the limit on expiry."""
        while self._entries:
            request_id, entry = next(iter(self._entries.items()))
            if entry.reply is None or entry.until_ns >= now_ns:
                return
            del self._entries[request_id]
            self._bytes -= len(entry.reply)
