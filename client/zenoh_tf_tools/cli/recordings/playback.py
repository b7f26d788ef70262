"""Which messages of a recording are played, when, and with which stamps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from zenoh_tf.recordings import Message
from zenoh_tf_tools.errors import CommandError

#: From the last stamp of a turn to the first of the next one.
_BETWEEN_TURNS_NS: Final = 10_000_000
#: The longest wait for a message, some 30 years: nobody means it, and `sleep` takes ten times that.
_MAX_WAIT_S: Final = 1e9


@dataclass(slots=True)
class Playback:
    """Plays the messages of a recording, once or again and again.

    Every turn's stamps follow those of the turn before: a tree takes no stamps that go back.
    """

    rate: float = 0.0  # times real speed; 0: without waiting
    start_s: float = 0.0  # after the first message: when to begin
    end_s: float | None = None  # and when to end
    now: bool = False  # stamps as if it happened now; requires a rate
    _first_stamp_ns: int | None = None  # of this turn
    _base_ns: int = 0  # what that becomes
    _last_stamp_ns: int | None = None  # as published

    def turn(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield what is played, each message at its time and with its new stamps.

        Static messages from before the start are played first: they hold at all times.
        """
        self._first_stamp_ns = None
        first_log_ns = begin_s = None
        for message in messages:
            first_log_ns = message.log_ns if first_log_ns is None else first_log_ns
            offset_s = (message.log_ns - first_log_ns) / 1e9
            if self.end_s is not None and offset_s > self.end_s:
                break
            if offset_s < self.start_s:
                if message.static:
                    yield message
                continue
            if self.rate:
                begin_s = time.monotonic() if begin_s is None else begin_s
                due_s = begin_s + (offset_s - self.start_s) / self.rate
                wait_s = max(0.0, due_s - time.monotonic())
                if wait_s > _MAX_WAIT_S:
                    raise CommandError(
                        f"at --rate {self.rate:g} the next message, {offset_s:g} s after the "
                        f"first, is due in {wait_s:.3g} s: give a higher --rate, or an --end "
                        "before it"
                    )
                time.sleep(wait_s)
            yield message if message.static else self._stamped(message)

    def _stamped(self, message: Message) -> Message:
        """The message with the stamps that it is published with."""
        stamp = message.rows.stamp
        if not stamp.size:
            return message
        if self._first_stamp_ns is None:
            self._first_stamp_ns = int(stamp.max())
            self._base_ns = self._begin_turn(self._first_stamp_ns)
        since_first = stamp - self._first_stamp_ns
        if self.now and self.rate != 1.0:
            # Twice the speed is twice the velocity.
            since_first = np.rint(since_first / self.rate).astype(np.int64)
        moved = self._base_ns + since_first
        newest = int(moved.max())
        self._last_stamp_ns = max(newest, self._last_stamp_ns or newest)
        return message._replace(rows=message.rows._replace(stamp=moved))

    def _begin_turn(self, stamp_ns: int) -> int:
        """What the first stamp of a turn becomes."""
        begin_ns = time.time_ns() if self.now else stamp_ns
        if self._last_stamp_ns is None:
            return begin_ns
        after_ns = self._last_stamp_ns + _BETWEEN_TURNS_NS
        return max(begin_ns, after_ns) if self.now else after_ns
