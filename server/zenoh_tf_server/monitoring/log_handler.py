"""Writes log records to a file descriptor, at a bounded rate, and never waits for a reader.

A record may be caused by any client, and written by any worker. So each place in the code that logs
has a bounded rate. A reader that has stopped, such as a terminal after Ctrl-S, loses records
instead of holding the workers up. The next record that is written says how many are missing.

Thread safety: `handle` of the base class locks the handler.
"""

from __future__ import annotations

import logging
import os
import select
import time
from dataclasses import dataclass
from typing import Final

#: Records of one place in the code in a period, and those of them with a traceback.
PERIOD_S: Final = 5.0
MAX_RECORDS: Final = 100
MAX_TRACEBACKS: Final = 5

#: How long a record waits for its reader, and how long none waits after one has waited in vain.
_WAIT_MS: Final = 50
_PAUSE_S: Final = 1.0


@dataclass(slots=True)
class _Place:
    """A place in the code that logs. There are few, so none is forgotten."""

    until_s: float = 0.0  # the end of the period
    records: int = 0
    tracebacks: int = 0
    suppressed: int = 0  # since the last record that was written


class DescriptorHandler(logging.Handler):
    """Writes to a file descriptor that is a file, a pipe, a terminal or a socket."""

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        # Guarded by the handler's lock.
        self._places: dict[tuple[str, int], _Place] = {}
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLOUT)
        self._paused_until_s = 0.0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or count it as suppressed. Requires the handler's lock."""
        place = self._places.setdefault((record.pathname, record.lineno), _Place())
        if not self._may_log(place, bool(record.exc_info)):
            place.suppressed += 1
            return
        record.suppressed = place.suppressed
        try:
            written = self._write(f"{self.format(record)}\n".encode(errors="backslashreplace"))
        except OSError:  # the reader has gone: the service must not
            written = False
        place.suppressed = 0 if written else place.suppressed + 1

    def handleError(self, record: logging.LogRecord) -> None:
        """Do nothing: the base class would write the raw record to standard error."""

    def _may_log(self, place: _Place, with_traceback: bool) -> bool:
        now_s = time.monotonic()
        if now_s >= place.until_s:
            place.until_s = now_s + PERIOD_S
            place.records = place.tracebacks = 0
        place.records += 1
        place.tracebacks += with_traceback
        if place.records > MAX_RECORDS or (with_traceback and place.tracebacks > MAX_TRACEBACKS):
            return False
        return now_s >= self._paused_until_s

    def _write(self, data: bytes) -> bool:
        """Returns False if the reader does not read; part of the data may be written then."""
        while data:
            if not self._poll.poll(_WAIT_MS):
                self._paused_until_s = time.monotonic() + _PAUSE_S
                return False
            # This much fits into a pipe that can be written to, so the write does not wait.
            data = data[os.write(self._descriptor, data[: select.PIPE_BUF]) :]
        return True
