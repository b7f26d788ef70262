"""Keeps what Python needs to run a callback on a thread of Zenoh's.

PyO3 makes a thread state for each callback on a thread that Python does not know, and frees it
afterwards. Both together take as long as the callback itself. `keep_thread_state` lets the thread
keep its state. Zenoh has a few such threads, which live as long as the process.
"""

from __future__ import annotations

import ctypes
import threading

_known: set[int] = set()


def keep_thread_state() -> None:
    """Let the calling thread keep its thread state; to be called in each callback."""
    thread = threading.get_ident()
    if thread not in _known:
        _known.add(thread)
        # Without a matching release, the count of users of the state never becomes zero.
        ctypes.pythonapi.PyGILState_Ensure()
