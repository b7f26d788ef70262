"""Remembered outcomes of writes: a repeated request id gets the first one's answer.

Thread safety: all methods. An outcome is kept until the write's expiry, after which a
repeat is refused as expired: no repeat ever runs twice. Where there is no room to
remember, a write is refused rather than an unexpired outcome forgotten.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from .limits import Limits

#: Takes a reply's bytes, and whether it is an error. Called exactly once.
Answer = Callable[[bytes, bool], None]


@dataclass(slots=True)
class _Outcome:
    until_ns: int
    reply: bytes | None = None  # None: still running
    failed: bool = False
    joined: list[Answer] = field(default_factory=list)


class Outcomes:
    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._outcomes: OrderedDict[bytes, _Outcome] = OrderedDict()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._outcomes)

    def repeat(self, identity: bytes, answer: Answer) -> bool:
        """Answer a repeat with the first outcome, now or when it is there. False: no repeat."""
        with self._lock:
            outcome = self._outcomes.get(identity)
            if outcome is None:
                return False
            if outcome.reply is None:
                outcome.joined.append(answer)
                return True
        answer(outcome.reply, outcome.failed)
        return True

    def begin(self, identity: bytes, until_ns: int, now_ns: int, answer: Answer) -> bool:
        """True: the caller runs the write, then calls `finish`. False: a repeat came first,
        `answer` gets its outcome. Raises LimitExceeded where there is no room."""
        while not self.repeat(identity, answer):
            with self._lock:
                self._forget_expired(now_ns)
                if identity in self._outcomes:  # a repeat came between the two looks
                    continue
                self._limits.check("outcomes", len(self._outcomes) + 1)
                self._limits.check("outcome_bytes", self._bytes)
                self._outcomes[identity] = _Outcome(until_ns)
                return True
        return False

    def finish(self, identity: bytes, reply: bytes, failed: bool) -> None:
        """The outcome is known: remember it, and answer repeats that came meanwhile."""
        with self._lock:
            outcome = self._outcomes[identity]
            outcome.reply, outcome.failed = reply, failed
            joined, outcome.joined = outcome.joined, []
            self._bytes += len(reply)
        for answer in joined:
            answer(reply, failed)

    def _forget_expired(self, now_ns: int) -> None:
        """Forget from the oldest on; one that lives long holds back the younger ones behind
        it, by at most the limit on expiry."""
        while self._outcomes:
            identity, outcome = next(iter(self._outcomes.items()))
            if outcome.reply is None or outcome.until_ns >= now_ns:
                return
            del self._outcomes[identity]
            self._bytes -= len(outcome.reply)
