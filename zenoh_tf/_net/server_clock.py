"""How far the clocks of servers are ahead of this machine's, for mirrors: their age, and what
time it is at the server.

Thread safety: all methods. `age_s` and `real_ns` take no lock.

Internal: for `zenoh_tf_server` and `zenoh_tf_client`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final

from .. import unix

#: The best of so many latest comparisons counts.
COMPARISONS: Final = 6
#: Clocks are assumed to drift apart by less than 1 ns in this many.
_DRIFT: Final = 10_000


def now_ns() -> int:
    """This machine's clock, which also runs while the machine sleeps, where it has such a one."""
    return unix.boot_time_ns()


class ServerClock:
    """The clocks of a server instance and of the one before it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._latest = ""  # the instance that was compared last
        self._comparisons: deque[tuple[int, int]] = deque(maxlen=COMPARISONS)
        #: By instance: by how much its clock was ahead of this one's, at most, and when.
        self._best: dict[str, tuple[int, int]] = {}
        #: By how much an instance's real-time clock is ahead of its other; the last that said so.
        self._real = ("", 0)

    def compared(
        self, instance: str, begin_ns: int, clock_ns: int, real_ns: int | None = None
    ) -> None:
        """Take it that a server has read its clock after `begin_ns` of this machine's.

        `real_ns`: its real-time clock at the same time, if it has sent that.
        """
        at_ns = now_ns()
        if real_ns is not None:
            self.real_is(instance, clock_ns, real_ns)
        with self._lock:
            known = self._best
            if instance != self._latest:
                known = {name: best for name, best in known.items() if name == self._latest}
                self._latest = instance
                self._comparisons.clear()
            self._comparisons.append((clock_ns - begin_ns, at_ns))
            best = min(self._comparisons, key=lambda one: one[0] - one[1] // _DRIFT)
            self._best = known | {instance: best}

    def real_is(self, instance: str, clock_ns: int, real_ns: int) -> None:
        """Take it that a server's two clocks were `clock_ns` and `real_ns` at the same time."""
        self._real = instance, real_ns - clock_ns

    def age_s(self, instance: str, clock_ns: int) -> float:
        """How long ago a server's clock was `clock_ns`, at most; infinite if it is not known."""
        best = self._best.get(instance)
        if best is None:
            return float("inf")
        return max(0, _now_there_ns(best) - clock_ns) / 1e9

    def there_ns(self, instance: str) -> int | None:
        """The time by a server's clock now, at most; None if it is not known."""
        best = self._best.get(instance)
        return None if best is None else _now_there_ns(best)

    def real_ahead_ns(self, instance: str) -> int | None:
        """By how much a server's real-time clock is ahead of its other; None if it is not known."""
        known, ahead_ns = self._real
        return ahead_ns if known == instance else None

    def real_ns(self) -> int:
        """The time by the server's real-time clock, at most a round trip too late; by this
        machine's, if the server has not sent its own."""
        instance, ahead_ns = self._real
        best = self._best.get(instance)
        return time.time_ns() if best is None else _now_there_ns(best) + ahead_ns


def _now_there_ns(best: tuple[int, int]) -> int:
    """The time by a server's clock at most, from the best comparison with it."""
    offset_ns, at_ns = best
    here_ns = now_ns()
    return here_ns + offset_ns + (here_ns - at_ns) // _DRIFT
