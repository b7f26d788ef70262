"""Which messages of a recording are played, when, and with which stamps."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from zenoh_tf._core import TransformRows
from zenoh_tf.recordings import Message
from zenoh_tf_tools.errors import CommandError

#: From the last stamp of a turn to the first of the next one.
_BETWEEN_TURNS_NS: Final = 10_000_000
#: The first and last stamp that there are.
_FIRST_NS: Final = -(1 << 63)
_LAST_NS: Final = (1 << 63) - 1
#: The longest wait for a message, some 30 years; `sleep` accepts ten times that.
_MAX_WAIT_S: Final = 1e9


@dataclass(slots=True)
class Playback:
    """Plays the messages of a recording, once or again and again.

    Every turn's stamps follow those of the turn before: a tree accepts no stamps that go back.
    """

    rate: float = 0.0  # times real speed; 0: without waiting
    start_ns: int = _FIRST_NS  # the first and last stamp to play
    end_ns: int = _LAST_NS
    now: bool = False  # stamps as if it happened now; requires a rate
    _first_stamp_ns: int | None = None  # of this turn
    _base_ns: int = 0  # what that becomes
    _last_stamp_ns: int | None = None  # as published

    def turn(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield what is played, each message at its time and with its new stamps.

        Static messages from before the start and after the end are played without waiting: they
        hold at all times.
        """
        self._first_stamp_ns = None
        begin_log_ns, begin_s = None, 0.0
        is_begun, is_over = self.start_ns == _FIRST_NS, False
        for message in messages:
            part: Message | None = message
            if not message.static:
                is_over = is_over or bool((message.rows.stamp > self.end_ns).any())
                part = self._part(message)
                is_begun = is_begun or part is not None
            if part is None:
                continue
            if self.rate and is_begun and not (part.static and is_over):
                if begin_log_ns is None:
                    begin_log_ns, begin_s = part.log_ns, time.monotonic()
                self._wait(begin_s, (part.log_ns - begin_log_ns) / 1e9)
            yield part if part.static else self._stamped(part)

    def _part(self, message: Message) -> Message | None:
        """The rows of a dynamic message that are played; None if none are."""
        stamp = message.rows.stamp
        inside = (stamp >= self.start_ns) & (stamp <= self.end_ns)
        if inside.all():
            return message
        part = message.rows[inside.nonzero()[0]]
        return message._replace(rows=part) if len(part) else None

    def _wait(self, begin_s: float, offset_s: float) -> None:
        """Wait until a message is due that is this long after the first one."""
        wait_s = max(0.0, begin_s + offset_s / self.rate - time.monotonic())
        if wait_s > _MAX_WAIT_S:
            raise CommandError(
                f"at --rate {self.rate:g} the next message, {offset_s:g} s after the first, is due "
                f"in {wait_s:.3g} s: give a higher --rate, or an --end before it"
            )
        time.sleep(wait_s)

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
        rows = message.rows
        return message._replace(
            rows=TransformRows(rows.names, rows.parent, rows.child, moved, rows.pose)
        )

    def _begin_turn(self, stamp_ns: int) -> int:
        """What the first stamp of a turn becomes."""
        begin_ns = time.time_ns() if self.now else stamp_ns
        if self._last_stamp_ns is None:
            return begin_ns
        after_ns = self._last_stamp_ns + _BETWEEN_TURNS_NS
        return max(begin_ns, after_ns) if self.now else after_ns
