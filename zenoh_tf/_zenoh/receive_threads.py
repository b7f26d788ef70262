"""The number of Zenoh's receive threads.

Zenoh has two, whatever the machine. A publisher that outruns the server occupies one of them while
it is held back: two such publishers shut out everybody's queries (eclipse-zenoh/zenoh#1876). Only
the environment changes the number: no setting of a session does.
"""

from __future__ import annotations

import os
from typing import Final

#: Where Zenoh reads the sizes of its thread pools, once in a process.
_RUNTIME: Final = "ZENOH_RUNTIME"
_RECEIVE_THREADS: Final = 16


def set_receive_threads() -> None:
    """Let Zenoh receive on more threads than by default, in this process. Must be called before
    its first session. A user's own `ZENOH_RUNTIME` stays."""
    os.environ.setdefault(_RUNTIME, f"(rx: (worker_threads: {_RECEIVE_THREADS}))")
