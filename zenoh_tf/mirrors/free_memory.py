"""Keeps what the next request will use, and gives other freed memory back to the system.

A server does so for its whole process. A client's process belongs to others: there it is done only
if `ZENOH_TF_TRIM_MEMORY` is set in the environment, for the heaps when the first connection opens,
and for freed memory after mirrors have replaced their copies.

glibc keeps in its heaps what large messages have used: 80 queued queries of 16 MB left 150 to
300 MB, all of it free. It gives that back on request. A request walks all free blocks while nobody
can allocate from their heap, 13 ms for 30 MB in small pieces, so it is made only after growth.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import functools
import os
from typing import Final

from .. import unix
from ..steps import Pause, Steps
from ..threads import Periodic

_INTERVAL_S: Final = 2.0
#: Growth after which free memory is given back.
_GROWTH_BYTES: Final = 32 << 20
_STATM: Final = "/proc/self/statm"
_HEAPS_OPTION: Final = -8  # of glibc's malloc.h
#: glibc makes 8 heaps for each core, and shares them out among threads. Each keeps the
#: most that it ever held: 480 clients, killed 20 at a time, left 84 MB with 16 heaps, 76 with 4.
_HEAPS: Final = 4
#: A client's program may have threads of its own. Ten mirrors took 196 MB with 32 heaps, 164 with
#: 8, 155 with 2; at most 226, 181 and 166 after restarts of the server.
_CLIENT_HEAPS: Final = 8
#: Blocks of up to this size come from a heap, and each heap keeps so much free memory at its end.
#: With glibc's own numbers, each request and reply of more than 128 kB were paged in again: 250
#: pages and 0.7 ms of processor time for a lookup of 10,000 rows.
_BLOCK_BYTES: Final = 4 << 20
_KEPT_BYTES: Final = 8 << 20
#: Any text but an empty one asks for it.
_ASKED_VARIABLE: Final = "ZENOH_TF_TRIM_MEMORY"
#: Of glibc's malloc.h, with the environment's name for it, which a user may have set.
_OPTIONS: Final = (
    (_HEAPS_OPTION, "MALLOC_ARENA_MAX", _HEAPS),
    (-3, "MALLOC_MMAP_THRESHOLD_", _BLOCK_BYTES),
    (-1, "MALLOC_TRIM_THRESHOLD_", _KEPT_BYTES),
)


#: A copy that was replaced is freed by then; what publishers send a new server comes later, on a
#: busy machine much later.
_SOON_S: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
#: None without glibc.
_TRIM: Final = getattr(unix.LIBC, "malloc_trim", None)


def give_back() -> None:
    """Give all freed memory of the process back to the system; does nothing without glibc."""
    if _TRIM is not None:
        _TRIM(0)


def give_back_soon() -> Steps[None]:
    """Give back what replacing a copy has used, if the process asks for it. Each request has a
    thread, so perhaps a heap of its own, which would keep the most that it ever held."""
    for pause_s in _SOON_S if _is_asked() else ():
        if (yield Pause(pause_s)):
            return
        give_back()


class FreeMemory(Periodic):
    """Gives free memory back whenever the process has grown; does nothing without glibc."""

    def __init__(self) -> None:
        super().__init__("free-memory", self._give_back, _INTERVAL_S)

    def start(self) -> None:
        """Begin to watch the process's size."""
        if _TRIM is not None and os.path.exists(_STATM):
            self._least = resident_bytes()
            super().start()

    def _give_back(self) -> None:
        with contextlib.suppress(OSError):  # the process has no free file: the next time will do
            now = resident_bytes()
            if now > self._least + _GROWTH_BYTES:
                give_back()
                self._least = resident_bytes()
            self._least = min(self._least, now)


def set_up_heaps() -> None:
    """Let all threads of a server share a few heaps, which keep what the next request will use;
    does nothing without glibc. To be called before threads start. What a user has set stays."""
    for option, variable, value in _OPTIONS:
        _set(option, variable, value)


@functools.cache
def limit_heaps() -> None:
    """Limit the heaps of a client's process if it asks for it, unless its threads have more
    already, or its user has set a limit; does nothing without glibc."""
    if _is_asked():
        _set(_HEAPS_OPTION, "MALLOC_ARENA_MAX", _CLIENT_HEAPS)


def _is_asked() -> bool:
    return bool(os.environ.get(_ASKED_VARIABLE))


def _set(option: int, variable: str, value: int) -> None:
    set_option = getattr(unix.LIBC, "mallopt", None)
    if set_option is not None and variable not in os.environ:
        set_option(option, value)


def resident_bytes() -> int:
    """The memory that this process has in use, of Linux."""
    with open(_STATM, encoding="utf-8") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
