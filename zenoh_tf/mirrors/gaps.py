"""What a mirror does with a gap in the stream.

A message has a gap before it if it does not follow the last one that the copy has. Then it waits,
as do all that come after it, while `Mirroring` asks the server for the missed ones. Their reply
closes the gap. If the server has evicted them, or too many bytes wait, the mirror restarts with a
snapshot. Messages that come while a snapshot is loaded wait here as well, as the bytes that came:
decoded they may take twenty times as much.

Internal: for `zenoh_tf.mirrors.mirroring`.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from .. import wire
from .copy import Copy
from .shared_bytes import SharedBytes

#: What a message costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 1000


class _Waiting(NamedTuple):
    instance: str
    first: int
    last: int
    data: bytes

    @property
    def size(self) -> int:
        return len(self.data) + _OVERHEAD_BYTES


class WaitingMessages:
    """The messages that wait for missed ones, or for a snapshot."""

    def __init__(self, room: SharedBytes) -> None:
        """`room`: for what waits here, and in other mirrors that share it."""
        self._room = room
        #: Those that wait, from the first on. Others only read it.
        self.messages: deque[_Waiting] = deque()
        self._bytes = 0
        #: Whether messages are missing between the copy and those that wait.
        self.has_gap = False
        #: The number of the last message that waited when the missed ones were requested.
        self.asked_until = 0

    def add(self, message: wire.StreamMessage, data: bytes) -> bool:
        """Let a message wait, which came as `data`. False if too many bytes do."""
        waiting = _Waiting(message.instance, message.first, message.last, data)
        if not self._room.take(self._bytes, waiting.size):
            return False
        self.messages.append(waiting)
        self._bytes += waiting.size
        return True

    def take_next(self, seq: int) -> wire.StreamMessage | None:
        """Return the next message if it follows `seq`; else there is a gap before it."""
        self.has_gap = bool(self.messages) and self.messages[0].first > seq + 1
        if self.has_gap or not self.messages:
            return None
        waiting = self.messages.popleft()
        self._free(waiting.size)
        return wire.unpack_stream(waiting.data)

    def request(self, copy: Copy, interest: wire.Interest | None) -> wire.Message:
        """The request for the messages that the copy lacks."""
        self.asked_until = max((waiting.last for waiting in self.messages), default=0)
        return wire.missed_request(copy.instance, copy.seq + 1, interest)

    def close_gap(self, copy: Copy, missed: list[bytes]) -> None:
        """Apply the missed messages."""
        copy.repeats.clear()
        for data in missed:
            message = wire.unpack_stream(data)
            if message.first <= copy.seq + 1:
                copy.repeats[message.last] = hash(data)
                copy.apply(message)
        self.has_gap = False

    def keep_only(self, instance: str) -> None:
        """Drop the messages of other server instances."""
        kept = deque(waiting for waiting in self.messages if waiting.instance == instance)
        self._free(self._bytes - sum(waiting.size for waiting in kept))
        self.messages = kept

    def clear(self) -> None:
        """Drop all messages."""
        self.messages.clear()
        self._free(self._bytes)
        self.has_gap = False

    def _free(self, size: int) -> None:
        self._room.give_back(size)
        self._bytes -= size
