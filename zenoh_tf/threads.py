"""Threads that do not keep their process alive: their start, their end, pauses, and work at a
period.

Thread safety: all functions, and all methods.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Final

log = logging.getLogger("zenoh_tf")

#: A part that closes waits so long for the end of each of its threads, then continues without.
JOIN_TIMEOUT_S: Final = 0.5


def start(name: str, work: Callable[..., object], *arguments: object) -> threading.Thread:
    """Start a thread. Raises RuntimeError if the system has none left."""
    thread = threading.Thread(target=work, args=arguments, name=name, daemon=True)
    thread.start()
    return thread


def join(*threads: threading.Thread | None, timeout_s: float = JOIN_TIMEOUT_S) -> None:
    """Wait until threads have ended, for `timeout_s` each at most. None: it was never started."""
    for thread in threads:
        if thread is not None:
            thread.join(timeout_s)


def pauses(first_s: float, longest_s: float) -> Iterator[float]:
    """Pauses between attempts, each twice the one before (exponential backoff)."""
    while True:
        yield first_s
        first_s = min(2 * first_s, longest_s)


class Periodic:
    """Work at a period on a thread of its own. After an error, which is logged, it continues."""

    def __init__(
        self, name: str, work: Callable[[], object], period_s: float, *, at_end: bool = False
    ) -> None:
        """`work` runs first after `period_s`, and with `at_end` once more on closing."""
        self._name = name
        self._work = work
        self._period_s = period_s
        self._at_end = at_end
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin."""
        self._thread = start(self._name, self._run)

    def close(self, timeout_s: float = JOIN_TIMEOUT_S) -> None:
        """End the thread, if it was started."""
        self._closing.set()
        join(self._thread, timeout_s=timeout_s)

    def pause(self, pause_s: float) -> bool:
        """Wait, for the work itself. True: it is to end."""
        return self._closing.wait(pause_s)

    def _run(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(self._period_s)
            if closing and not self._at_end:
                return
            try:
                self._work()
            except Exception:
                log.exception("internal error in the thread %s", self._name)
