"""How far the clocks of servers are ahead of this machine's, for the age of mirrors.

Thread safety: all methods. `age_s` takes no lock.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final

#: The best of so many latest comparisons counts.
COMPARISONS: Final = 6
#: Clocks are assumed to drift apart by less than 1 ns in this many.
_DRIFT: Final = 10_000


def now_ns() -> int:
    """This machine's clock, which also runs while the machine sleeps, where it has such a one."""
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    return time.clock_gettime_ns(clock)


class ServerClock:
    """The clocks of a server instance and of the one before it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._latest = ""  # the instance that was compared last
        self._comparisons: deque[tuple[int, int]] = deque(maxlen=COMPARISONS)
        #: By instance: by how much its clock was ahead of this one's, at most, and when.
        self._best: dict[str, tuple[int, int]] = {}

    def compared(self, instance: str, begin_ns: int, clock_ns: int) -> None:
        """Take it that a server has read its clock after `begin_ns` of this machine's."""
        at_ns = now_ns()
        with self._lock:
            known = self._best
            if instance != self._latest:
                known = {name: best for name, best in known.items() if name == self._latest}
                self._latest = instance
                self._comparisons.clear()
            self._comparisons.append((clock_ns - begin_ns, at_ns))
            best = min(self._comparisons, key=lambda one: one[0] - one[1] // _DRIFT)
            self._best = known | {instance: best}

    def age_s(self, instance: str, clock_ns: int) -> float:
        """How long ago a server's clock was `clock_ns`, at most; infinite if it is not known."""
        best = self._best.get(instance)
        if best is None:
            return float("inf")
        offset_ns, at_ns = best
        here_ns = now_ns()
        offset_ns += (here_ns - at_ns) // _DRIFT
        return max(0, here_ns + offset_ns - clock_ns) / 1e9
