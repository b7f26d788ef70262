"""The stream's latest messages, for mirrors that have missed some: bounded in bytes.

Thread safety: all methods.
Invariant: the messages follow each other: each begins with the number after the one before.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class _Message:
    first: int
    last: int
    data: bytes


class RecentMessages:
    """The latest messages of a stream."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._messages: deque[_Message] = deque()
        self._bytes = 0

    def add(self, first: int, last: int, data: bytes) -> None:
        """Add the message of the numbers from `first` to `last`, and forget the oldest ones."""
        with self._lock:
            self._messages.append(_Message(first, last, data))
            self._bytes += len(data)
            while self._bytes > self._max_bytes:
                self._bytes -= len(self._messages.popleft().data)

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._messages.clear()
            self._bytes = 0

    def since(self, number: int, most_bytes: int) -> list[bytes]:
        """The messages from that with `number` on, until they have `most_bytes` or more. None if
        that one is not known."""
        with self._lock:
            if not self._messages or number < self._messages[0].first:
                return []
            found: list[bytes] = []
            size = 0
            for message in reversed(self._messages):
                if message.last < number:
                    break
                found.append(message.data)
            found.reverse()
        for count, data in enumerate(found):
            size += len(data)
            if size >= most_bytes:
                return found[: count + 1]
        return found

    @property
    def bytes(self) -> int:
        """The bytes of all messages."""
        return self._bytes
