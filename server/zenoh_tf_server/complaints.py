"""Warnings at a bounded rate: a broken sensor must not fill the log."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass

#: One line per source and period; sources beyond the bound share one.
PERIOD_S = 5.0
MAX_SOURCES = 256


@dataclass(slots=True)
class _Source:
    next_s: float = 0.0
    silent: int = 0


class Complaints:
    """Thread safety: all methods."""

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._lock = threading.Lock()
        self._sources: dict[str, _Source] = {}

    def warn(self, source: str, reason: str) -> None:
        """Log `reason` for `source`, unless one was logged within the period."""
        now = time.monotonic()
        with self._lock:
            if source not in self._sources and len(self._sources) >= MAX_SOURCES:
                source = "(others)"
            entry = self._sources.setdefault(source, _Source())
            if now < entry.next_s:
                entry.silent += 1
                return
            silent, entry.silent = entry.silent, 0
            entry.next_s = now + PERIOD_S
        more = f" ({silent} more since the last such line)" if silent else ""
        self._logger.warning("%s: %s%s", source, reason, more)
