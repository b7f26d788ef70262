"""The stream's latest messages, for mirrors that have missed some: bounded in bytes.

Thread safety: all methods.
Invariant: the messages follow each other: each begins with the number after the one before.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

#: What a message costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 200


@dataclass(frozen=True, slots=True)
class _Message:
    first: int
    last: int
    data: bytes

    @property
    def cost(self) -> int:
        return len(self.data) + _OVERHEAD_BYTES


class RecentMessages:
    """The latest messages of a stream."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._messages: list[_Message] = []  # those before `_begin` are forgotten
        self._begin = 0
        #: What all messages cost.
        self.bytes = 0

    def add(self, first: int, last: int, data: bytes) -> None:
        """Add the message of the numbers from `first` to `last`, and forget the oldest ones."""
        message = _Message(first, last, data)
        with self._lock:
            self._messages.append(message)
            self.bytes += message.cost
            while self.bytes > self._max_bytes:
                self.bytes -= self._messages[self._begin].cost
                self._begin += 1
            if self._begin > len(self._messages) // 2:
                del self._messages[: self._begin]
                self._begin = 0

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._messages.clear()
            self._begin = self.bytes = 0

    def since(self, number: int, most_bytes: int) -> list[bytes]:
        """The messages from that with `number` on, until they have `most_bytes` or more. Empty if
        that one is not known."""
        found: list[bytes] = []
        with self._lock:
            messages = self._messages
            if len(messages) == self._begin or number < messages[self._begin].first:
                return found
            at = bisect_left(messages, number, lo=self._begin, key=attrgetter("last"))
            while at < len(messages) and most_bytes > 0:
                found.append(messages[at].data)
                most_bytes -= messages[at].cost
                at += 1
        return found
