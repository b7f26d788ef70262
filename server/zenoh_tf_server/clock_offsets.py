"""How far the stamps of each authority, and the clocks of the clients, are from this clock.

A put tells less than one would like: its stamp less its arrival is the sender's clock error less
the time that the transform needed to arrive. The largest such difference of a while is nearest to
the clock error, as it has the least delay in it, and the true error is that or more. The smallest
one has the most delay in it. Both together say what is wrong: a clock that runs ahead moves both
above zero, a slow or queueing sensor only the smaller one, and a clock that drifts moves both
together.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, Final

#: Differences older than two of these do not count.
WINDOW_NS: Final = 10_000_000_000
#: Authorities and clients remembered, each; the one that was heard longest ago is forgotten.
_MAX_ENTRIES: Final = 4096
#: An interval that excludes zero by more than this is reported.
REPORT_S: Final = 1.0
#: Assumed of a client that does not know its round trip yet.
_UNKNOWN_DELAY_NS: Final = 1_000_000_000
#: Stamps further back than this are of a simulation or a recording, not of a wrong clock.
_LONGEST_AGO_S: Final = 86_400.0


@dataclass(slots=True)
class _Window:
    """Least and greatest of what was measured in one period and the one before it."""

    begin_ns: int
    least_ns: int
    greatest_ns: int
    least_before_ns: int
    greatest_before_ns: int
    last_ns: int

    @classmethod
    def of(cls, now_ns: int, least_ns: int, greatest_ns: int) -> _Window:
        return cls(now_ns, least_ns, greatest_ns, least_ns, greatest_ns, greatest_ns)

    def add(self, now_ns: int, least_ns: int, greatest_ns: int) -> None:
        elapsed_ns = now_ns - self.begin_ns
        if not 0 <= elapsed_ns < WINDOW_NS:
            if 0 <= elapsed_ns < 2 * WINDOW_NS:
                self.least_before_ns, self.greatest_before_ns = self.least_ns, self.greatest_ns
            else:  # silent for a while, or this clock was set
                self.least_before_ns, self.greatest_before_ns = least_ns, greatest_ns
            self.begin_ns, self.least_ns, self.greatest_ns = now_ns, least_ns, greatest_ns
        else:
            self.least_ns = min(self.least_ns, least_ns)
            self.greatest_ns = max(self.greatest_ns, greatest_ns)
        self.last_ns = greatest_ns

    def interval_s(self) -> tuple[float, float]:
        return (
            min(self.least_ns, self.least_before_ns) * 1e-9,
            max(self.greatest_ns, self.greatest_before_ns) * 1e-9,
        )


class ClockOffsets:
    """Intervals of clock offsets: positive if the other clock, or its stamps, are ahead."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._authorities: OrderedDict[str, _Window] = OrderedDict()  # heard longest ago first
        self._clients: OrderedDict[str, _Window] = OrderedDict()

    def put_arrived(self, authority: str, arrival_ns: int, newest_stamp_ns: int) -> None:
        """Note the newest stamp of a put, and when it arrived by this machine's real-time clock."""
        ahead_ns = newest_stamp_ns - arrival_ns
        self._add(self._authorities, authority, arrival_ns, ahead_ns, ahead_ns)

    def client_told(self, client: str, clock_ns: int, round_trip_ns: int) -> None:
        """Note a client's real-time clock when it sent a message that has arrived now.

        Args:
            client: The client's id.
            clock_ns: Its clock.
            round_trip_ns: How long its last request and the reply took: an upper bound, mostly,
                of the time that this message needed. Negative: it does not know.
        """
        if not client or abs(clock_ns) >= 1 << 62:
            return
        now_ns = time.time_ns()
        ahead_ns = clock_ns - now_ns
        delay_ns = _UNKNOWN_DELAY_NS if round_trip_ns < 0 else round_trip_ns
        self._add(self._clients, client, now_ns, ahead_ns, ahead_ns + delay_ns)

    def _add(
        self, windows: OrderedDict[str, _Window], name: str, now_ns: int, least: int, greatest: int
    ) -> None:
        with self._lock:
            window = windows.get(name)
            if window is not None:
                window.add(now_ns, least, greatest)
                windows.move_to_end(name)
                return
            windows[name] = _Window.of(now_ns, least, greatest)
            if len(windows) > _MAX_ENTRIES:
                windows.popitem(last=False)

    def add_to(self, records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The authority records with what is known of each one's clock."""
        with self._lock:
            known = {name: _fields(window) for name, window in self._authorities.items()}
        nothing = dict.fromkeys(("clock_offset_min_s", "clock_offset_max_s", "stamp_age_s"))
        return [{**record, **known.get(record["name"], nothing)} for record in records]

    def suspicious(self) -> list[tuple[str, str]]:
        """Authorities and clients whose clock seems wrong: whose, and why."""
        with self._lock:
            all_windows = [
                (f"{kind} {name!r}", kind, window.interval_s())
                for kind, windows in (("authority", self._authorities), ("client", self._clients))
                for name, window in windows.items()
            ]
        return [
            (owner, reason)
            for owner, kind, (least, greatest) in all_windows
            if (reason := _judge(kind, least, greatest)) is not None
        ]


def _fields(window: _Window) -> dict[str, float]:
    least, greatest = window.interval_s()
    return {
        "clock_offset_min_s": least,
        "clock_offset_max_s": greatest,
        "stamp_age_s": -window.last_ns * 1e-9,
    }


def _judge(kind: str, least_s: float, greatest_s: float) -> str | None:
    """Why an interval is reported; None if it is not."""
    what = "its stamps are" if kind == "authority" else "its clock is"
    if least_s > REPORT_S:
        return f"{what} {least_s:.1f} to {greatest_s:.1f} s ahead of this server's clock"
    if -_LONGEST_AGO_S < greatest_s < -REPORT_S:
        return (
            f"{what} {-greatest_s:.1f} to {-least_s:.1f} s behind this server's clock: its clock "
            "is wrong, or its data is late"
        )
    return None
