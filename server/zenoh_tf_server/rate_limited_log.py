"""Warnings at a bounded rate: a broken sensor must not fill the log."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from zenoh_tf.text import cut, printable

#: At most one line per source and period.
PERIOD_S: Final = 5.0
#: At most this many lines per period, over all sources.
MAX_LINES: Final = 60
#: Sources remembered. The one that was logged longest ago is forgotten for a new one.
MAX_SOURCES: Final = 256
_MAX_SOURCE: Final = 200
_MAX_REASON: Final = 500


@dataclass(slots=True)
class _LineCounts:
    next_s: float = 0.0  # no line before this time
    suppressed: int = 0  # lines since the last one that was logged


class RateLimitedLog:
    """Logs lines about the input of others, at most one per source and period.

    Each line is escaped and cut. Thread safety: all methods.
    """

    def __init__(self, logger: logging.Logger, period_s: float = PERIOD_S) -> None:
        self._logger = logger
        self._period_s = period_s
        self._lock = threading.Lock()
        self._sources: OrderedDict[str, _LineCounts] = OrderedDict()  # logged longest ago first
        self._all = _LineCounts()  # of all sources together, once the lines of a period are used up
        self._period_ends_s = 0.0
        self._lines = 0  # in this period

    def warn(self, source: str, reason: str) -> None:
        """Log a warning: `reason` for `source`, or count it as suppressed."""
        self._write(logging.WARNING, source, reason)

    def info(self, source: str, reason: str) -> None:
        """As `warn`, for what is no fault."""
        self._write(logging.INFO, source, reason)

    def _write(self, level: int, source: str, reason: str) -> None:
        suppressed = self._admit(source[: 2 * _MAX_SOURCE])
        if suppressed is None:
            return
        more = f" ({suppressed} more were suppressed)" if suppressed else ""
        self._logger.log(
            level, "%s: %s%s", _safe(source, _MAX_SOURCE), _safe(reason, _MAX_REASON), more
        )

    def _admit(self, source: str) -> int | None:
        """Return how many lines were suppressed before this one; None: this one is, too."""
        now = time.monotonic()
        with self._lock:
            if now >= self._period_ends_s:
                self._period_ends_s, self._lines = now + self._period_s, 0
            entry = self._sources.get(source)
            if self._lines >= MAX_LINES:
                (entry or self._all).suppressed += 1
                return None
            if entry is None:
                if len(self._sources) >= MAX_SOURCES:
                    self._all.suppressed += self._sources.popitem(last=False)[1].suppressed
                entry = self._sources[source] = _LineCounts()
            elif now < entry.next_s:
                entry.suppressed += 1
                return None
            self._lines += 1
            self._sources.move_to_end(source)
            entry.next_s = now + self._period_s
            suppressed = entry.suppressed + self._all.suppressed
            entry.suppressed = self._all.suppressed = 0
            return suppressed


def _safe(text: str, limit: int) -> str:
    return printable(cut(text, limit))
