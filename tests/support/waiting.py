"""Waiting for what a server, a client or another thread does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

#: Longer than anything takes that works; pytest gives up on a test later.
DEADLINE_S = 150.0


def wait_until(condition: Callable[[], T], what: str | Callable[[], object] = "") -> T:
    """The first result of `condition` that is true. Without one in time it fails, and says `what`
    was waited for and the last result."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not (result := condition()):
        if time.monotonic() > deadline_s:
            raise AssertionError(f"{what() if callable(what) else what}: still {result!r}")
        time.sleep(0.01)
    return result
