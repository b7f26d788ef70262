"""What a mirror does with a gap in the stream.

A message has a gap before it if it does not follow the last one that the copy has. Then it waits,
as do all that come after it, while `Mirroring` asks the server for the missed ones. Their reply
closes the gap. If the server has evicted them, or too many bytes wait, the mirror restarts with a
snapshot. Messages that come while a snapshot is loaded wait here as well.

Internal: for `zenoh_tf.mirrors.mirroring`.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from .. import wire
from .copy import Copy

#: What a message costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 1000


class WaitingMessages:
    """The messages that wait for missed ones, or for a snapshot."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._waiting: deque[tuple[wire.StreamMessage, int]] = deque()  # and their bytes
        self._bytes = 0
        #: Whether messages are missing between the copy and those that wait.
        self.has_gap = False
        #: The number of the last message that waited when the missed ones were requested.
        self.asked_until = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, message: wire.StreamMessage, size: int) -> bool:
        """Let a message wait. False if too many bytes do."""
        size += _OVERHEAD_BYTES
        self._waiting.append((message, size))
        self._bytes += size
        return self._bytes <= self._max_bytes

    def take_next(self, seq: int) -> wire.StreamMessage | None:
        """Return the next message if it follows `seq`; else there is a gap before it."""
        self.has_gap = bool(self._waiting) and self._waiting[0][0].first > seq + 1
        if self.has_gap or not self._waiting:
            return None
        message, size = self._waiting.popleft()
        self._bytes -= size
        return message

    def request(self, copy: Copy, interest: wire.Interest | None) -> wire.Message:
        """The request for the messages that the copy lacks."""
        self.asked_until = max((m.last for m, _ in self._waiting), default=0)
        return wire.missed_request(copy.instance, copy.seq + 1, interest)

    def close_gap(self, copy: Copy, missed: list[bytes]) -> None:
        """Apply the missed messages."""
        copy.repeats.clear()
        for data in missed:
            message = wire.parse_stream(wire.unpack(data, wire.MAX_REPLY_BYTES))
            if message.first <= copy.seq + 1:
                copy.repeats[message.last] = hash(data)
                copy.apply(message)
        self.has_gap = False

    def keep_only(self, instance: str) -> None:
        """Drop the messages of other server instances."""
        kept = [(m, size) for m, size in self._waiting if m.instance == instance]
        self._waiting = deque(kept)
        self._bytes = sum(size for _, size in kept)

    def clear(self) -> None:
        """Drop all messages."""
        self._waiting.clear()
        self._bytes = 0
        self.has_gap = False
