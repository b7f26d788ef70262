"""The messages of one stream: numbered without gaps, published, and the latest ones kept.

Thread safety: `put` by one thread at a time; all other methods.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

import zenoh

from zenoh_tf import wire

#: A stream without changes has a message this often.
HEARTBEAT_S: Final = 0.1
#: A reply to `missed` has messages until they have this many bytes.
_MISSED_BYTES: Final = 1 << 20
#: The real-time clock is sent so often, and at once if it was set by so much.
_REAL_PERIOD_S: Final = 1.0
_SET_NS: Final = 1_000_000
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
    """The latest messages of a stream, bounded in bytes.

    Invariant: the messages follow each other: each begins with the number after the one before.
    """

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


class StreamPublisher:
    """Publishes the stream of a server instance."""

    def __init__(
        self, instance: str, kept_bytes: int, real_ahead_ns: Callable[[], int | None]
    ) -> None:
        """`kept_bytes`: the size of the latest messages that are kept for mirrors that missed
        some. `real_ahead_ns`: by how much the server's real-time clock is ahead of its other."""
        self._instance = instance
        self._real_ahead_ns = real_ahead_ns
        self._publisher: Any = None
        self.recent = RecentMessages(kept_bytes)
        #: The number with which the last message ends, and when it was put.
        self.last = 0
        self.put_s = 0.0
        self.messages = self.bytes = 0
        #: By how much the real-time clock was ahead of the other when it was sent last.
        self._ahead_ns = 0
        self._next_real_s = 0.0

    def start(self, session: zenoh.Session, key: str, changed: Callable[[], None]) -> None:
        """Publish on a key. Calls `changed` when there may be the first listener, or none left."""
        self._publisher = session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
            # This session subscribes to puts of transforms, on a key that includes the stream's.
            allowed_destination=zenoh.Locality.REMOTE,
        )
        self._publisher.declare_matching_listener(lambda status: changed())

    def close(self) -> None:
        """Publish no more. Raises ZError if the session is closed."""
        if self._publisher is not None:
            self._publisher.undeclare()

    def has_listeners(self) -> bool:
        """True if someone listens."""
        return self._publisher is not None and bool(self._publisher.matching_status.matching)

    def put(self, last: int, clock_ns: int, changes: bytes | None) -> None:
        """Put what the commits up to the number `last` have changed; without changes, a
        heartbeat."""
        first, self.last = self.last + 1, last
        real_ns = self._real_ns(clock_ns)
        message = wire.StreamMessage(self._instance, first, last, clock_ns, changes, real_ns)
        data = wire.pack(wire.stream_body(message))
        if last >= first:
            self.recent.add(first, last, data)
        self.messages += 1
        self.bytes += len(data)
        self.put_s = time.monotonic()
        if self._publisher is not None:
            self._publisher.put(data)

    def _real_ns(self, clock_ns: int) -> int | None:
        """The real-time clock at `clock_ns`: now and then, and at once if it was set."""
        ahead_ns = self._real_ahead_ns()
        now_s = time.monotonic()
        if ahead_ns is None:
            return None
        if abs(ahead_ns - self._ahead_ns) < _SET_NS and now_s < self._next_real_s:
            return None
        self._ahead_ns, self._next_real_s = ahead_ns, now_s + _REAL_PERIOD_S
        return clock_ns + ahead_ns

    def missed(self, first: int, last: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on. `last`:
        the number that the mirror can get by them and the stream."""
        return wire.missed_reply(self.recent.since(first, _MISSED_BYTES), last)
