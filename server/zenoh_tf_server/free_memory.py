"""Keeps little freed memory, and gives it back to the system.

glibc keeps in its heaps what large messages have used: 80 queued queries of 16 MB left 150 to
300 MB, all of it free. It gives that back on request. A request walks all free blocks while nobody
can allocate from their heap, 13 ms for 30 MB in small pieces, so it is made only after growth.

Thread safety: all methods.
"""

from __future__ import annotations

import ctypes
import os
import threading
from pathlib import Path
from typing import Final

_INTERVAL_S: Final = 2.0
#: Growth after which free memory is given back.
_GROWTH_BYTES: Final = 32 << 20
_JOIN_TIMEOUT_S: Final = 0.5
_STATM: Final = Path("/proc/self/statm")
#: glibc makes 8 heaps for each core, and shares them out among threads. Each keeps the
#: most that it ever held: 480 clients, killed 20 at a time, left 84 MB with 16 heaps, 76 with 4.
_HEAPS: Final = 4
_M_ARENA_MAX: Final = -8  # of glibc's malloc.h
_HEAPS_VARIABLE: Final = "MALLOC_ARENA_MAX"


class FreeMemory:
    """Gives free memory back whenever the process has grown; does nothing without glibc."""

    def __init__(self) -> None:
        self._trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="free-memory", daemon=True)

    def start(self) -> None:
        """Begin to watch the process's size."""
        if self._trim is not None and _STATM.exists():
            self._thread.start()

    def close(self) -> None:
        """Stop."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(_JOIN_TIMEOUT_S)

    def _run(self) -> None:
        assert self._trim is not None
        least = resident_bytes()
        while not self._stop.wait(_INTERVAL_S):
            now = resident_bytes()
            if now > least + _GROWTH_BYTES:
                self._trim(0)
                now = least = resident_bytes()
            least = min(least, now)


def limit_heaps() -> None:
    """Let all threads share a few heaps; does nothing without glibc. To be called before threads
    start. A user's own `MALLOC_ARENA_MAX` stays."""
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None and _HEAPS_VARIABLE not in os.environ:
        set_option(_M_ARENA_MAX, _HEAPS)


def resident_bytes() -> int:
    """The memory that this process has in use, of Linux."""
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
