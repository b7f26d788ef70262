"""Memory that several mirrors share: each may hold as much as is left free.

So with n that hold much, each has 1/(n+1) of the limit, and the next one always finds some.

Thread safety: all methods.

Internal: for `zenoh_tf.mirrors` and `zenoh_tf_server`.
"""

from __future__ import annotations

import threading


class SharedBytes:
    """A number of bytes that messages may take."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._lock = threading.Lock()
        self.used = 0

    def take(self, held: int, size: int) -> bool:
        """Take bytes for one that holds so many already. False: its share is used up."""
        with self._lock:
            fits = held + size <= self._limit - self.used - size
            self.used += size if fits else 0
        return fits

    def give_back(self, size: int) -> None:
        """Give bytes back that were taken."""
        with self._lock:
            self.used -= size
