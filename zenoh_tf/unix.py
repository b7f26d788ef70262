"""What Python has on Unix only, with what stands in for it elsewhere.

Thread safety: all functions.
"""

from __future__ import annotations

import ctypes
import os
import struct
import time
from collections.abc import Callable
from typing import Any, Final

try:
    import fcntl
    import termios
except ImportError:
    pass


def _c_library() -> Any:
    try:
        return ctypes.CDLL(None)
    except TypeError:
        return None


#: The C library of this process; None on Windows.
LIBC: Final = _c_library()


def after_fork(function: Callable[[], None]) -> None:
    """Call a function in each child that is forked from now on."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=function)


def boot_time_ns() -> int:
    """A clock that also runs while the system is suspended, where there is one."""
    if not hasattr(time, "clock_gettime_ns"):
        return time.monotonic_ns()
    return time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


def unsent_bytes(fd: int) -> int:
    """The bytes that were written to a socket and not acknowledged; 0 if it is closed."""
    try:
        unsent = fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0")
    except OSError:
        return 0
    return int(struct.unpack("i", unsent)[0])
