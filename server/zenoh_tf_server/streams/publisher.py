"""The messages of one stream: numbered without gaps, published, and the latest ones kept.

Thread safety: `put` by one thread at a time; all other methods.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zenoh_tf import wire

from .recent_messages import RecentMessages

#: A stream without changes has a message this often.
HEARTBEAT_S: Final = 0.1
#: A reply to `missed` has messages until they have this many bytes.
_MISSED_BYTES: Final = 1 << 20


class StreamPublisher:
    """Publishes the stream of a server instance."""

    def __init__(self, instance: str, kept_bytes: int) -> None:
        """`kept_bytes`: the size of the latest messages that are kept for mirrors that missed
        some."""
        self._instance = instance
        self._publisher: Any = None
        self.recent = RecentMessages(kept_bytes)
        #: The number with which the last message ends, and when it was put.
        self.last = 0
        self.put_s = 0.0
        self.messages = self.bytes = 0

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

    def put(self, last: int, clock_ns: int, changes: wire.Changes | None) -> None:
        """Put what the commits up to the number `last` have changed; without changes, a
        heartbeat."""
        first, self.last = self.last + 1, last
        message = wire.StreamMessage(self._instance, first, last, clock_ns, changes)
        data = wire.pack(wire.stream_body(message))
        if last >= first:
            self.recent.add(first, last, data)
        self.messages += 1
        self.bytes += len(data)
        self.put_s = time.monotonic()
        if self._publisher is not None:
            self._publisher.put(data)

    def missed(self, first: int, last: int) -> wire.Message:
        """The fields of the reply to `missed`: the messages from the number `first` on. `last`:
        the number that the mirror can get by them and the stream."""
        return wire.missed_reply(self.recent.since(first, _MISSED_BYTES), last)
