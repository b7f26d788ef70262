"""What a client has written and read of a server, so that its reads never go back.

A replica may have an older state than one that the client has seen: each request to it says what
it must have. The replica's memory says no such thing, so it is not read until the replica has
replied with that state once.

Thread safety: all methods; attributes may be read at any time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from zenoh_tf import wire

from ..requests.receipt import Receipt, later


class SeenStates:
    """The latest state that one client has seen."""

    def __init__(self) -> None:
        #: What reads of a replica must see: what the client has written, and what it has read.
        self.least: Receipt | None = None
        #: Of the latest write that the server has replied to.
        self.last_receipt: Receipt | None = None
        #: What the replica may lack; None if its memory may be read. Read it before `least`, which
        #: is never older.
        self.awaited: Receipt | None = None
        #: Called when memory may be read again, or must not be read any more.
        self.on_behind: Callable[[], None] = lambda: None
        self._lock = threading.Lock()

    @property
    def is_behind(self) -> bool:
        """True while the replica may lack what the client has seen."""
        return self.awaited is not None

    def is_news(self, instance: object, seq: int) -> bool:
        """Whether a reply has seen more than any reply before. Takes no lock."""
        least = self.least
        return least is None or seq > least.seq or instance != least.instance

    def record_read(self, instance: str, seq: int) -> None:
        """Accept that a read has seen at most `seq` of an instance."""
        with self._lock:
            if self.is_news(instance, seq):
                self.least = Receipt(instance, seq)

    def record_server(self, instance: str, seq: int, before: Receipt | None) -> None:
        """Accept the number of a read by the server itself, which was sent after `before` was
        seen. A higher one is forged: the server knows best."""
        with self._lock:
            if before is self.least and before is not None and before.instance == instance:
                self.least = Receipt(instance, seq)
        self.record_read(instance, seq)

    def record_write(self, reply: wire.Message) -> None:
        """Accept the reply to a write."""
        with self._lock:
            self.last_receipt = written = later(self.last_receipt, reply)
            if written is not None and self.is_news(written.instance, written.seq):
                self.least = written

    def await_replica(self) -> None:
        """Do not read a replica's memory until it has replied with what was seen, if anything."""
        with self._lock:
            if self.least is not None:
                self.awaited = self.least
                self.on_behind()

    def caught_up(self, awaited: Receipt) -> None:
        """Accept that the replica has what was awaited."""
        with self._lock:
            if self.awaited is awaited:  # the client has seen nothing newer meanwhile
                self.awaited = None
                self.on_behind()
