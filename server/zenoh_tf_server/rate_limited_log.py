"""Warnings at a bounded rate: a broken sensor must not fill the log."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass
from typing import Final

#: At most one line per source and period.
PERIOD_S: Final = 5.0
#: Sources beyond this many share one entry.
MAX_SOURCES: Final = 256
_OTHER_SOURCES: Final = "(other sources)"


@dataclass(slots=True)
class _Source:
    next_s: float = 0.0  # no line before this time
    suppressed: int = 0  # lines since the last one that was logged


class RateLimitedLog:
    """Logs warnings, at most one per source and period. Thread safety: all methods."""

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._lock = threading.Lock()
        self._sources: dict[str, _Source] = {}

    def warn(self, source: str, reason: str) -> None:
        """Log `reason` for `source`, or count it as suppressed if the period is not over."""
        now = time.monotonic()
        with self._lock:
            if source not in self._sources and len(self._sources) >= MAX_SOURCES:
                source = _OTHER_SOURCES
            entry = self._sources.setdefault(source, _Source())
            if now < entry.next_s:
                entry.suppressed += 1
                return
            suppressed, entry.suppressed = entry.suppressed, 0
            entry.next_s = now + PERIOD_S
        more = f" ({suppressed} more were suppressed)" if suppressed else ""
        self._logger.warning("%s: %s%s", source, reason, more)
