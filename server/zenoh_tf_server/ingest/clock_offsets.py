"""How far the stamps of each authority, and the clocks of the clients, are from this clock.

A put does not carry its sender's clock error: its stamp less its arrival is that error less the
time that the transform needed to arrive. The largest such difference of a while is nearest to the
clock error, as it has the least delay in it, and the true error is that or more. The smallest one
has the most delay in it. Both together say what is wrong: a clock that runs ahead moves both above
zero, a slow or queueing sensor only the smaller one, and a clock that drifts moves both together.

A client sends its clock in `hello`. That clock less the arrival is the clock error less the time
that the message needed. The next `hello` has the round trip of this one, which bounds that time,
and names it by its clock: one that was not answered in time may have arrived all the same, later.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, Final

from zenoh_tf.bounded_map import BoundedMap

#: Differences older than two of these do not count, as long as there are newer ones.
WINDOW_NS: Final = 10_000_000_000
#: Authorities and clients remembered, each; the one that was heard longest ago is forgotten.
#: Clients are also forgotten when they disconnect.
_MAX_ENTRIES: Final = 4096
#: An interval that excludes zero by more than this is reported.
REPORT_S: Final = 1.0
#: Assumed of a client's first `hello`, until the next one has its round trip.
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
    heard_ns: int

    @classmethod
    def of(cls, now_ns: int, least_ns: int, greatest_ns: int) -> _Window:
        return cls(now_ns, least_ns, greatest_ns, least_ns, greatest_ns, greatest_ns, now_ns)

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
        self.heard_ns = now_ns

    def interval_s(self) -> tuple[float, float]:
        return (
            min(self.least_ns, self.least_before_ns) * 1e-9,
            max(self.greatest_ns, self.greatest_before_ns) * 1e-9,
        )


@dataclass(slots=True)
class _Client:
    """What the messages of a client say of its clock."""

    heard_ns: int
    ahead_ns: int  # of the last message
    clock_ns: int  # the client's, in the last message
    measured: _Window | None = None  # by those whose round trip is known

    def add(self, now_ns: int, clock_ns: int, round_trip_ns: int, of_ns: int) -> None:
        """Add a message, and the round trip of one before, which had the clock `of_ns`; negative:
        it is not known."""
        if round_trip_ns >= 0 and of_ns == self.clock_ns:
            least, greatest = self.ahead_ns, self.ahead_ns + round_trip_ns
            if self.measured is None:
                self.measured = _Window.of(self.heard_ns, least, greatest)
            else:
                self.measured.add(self.heard_ns, least, greatest)
        self.heard_ns, self.ahead_ns, self.clock_ns = now_ns, clock_ns - now_ns, clock_ns

    def interval_s(self) -> tuple[float, float]:
        if self.measured is not None:
            return self.measured.interval_s()
        return self.ahead_ns * 1e-9, (self.ahead_ns + _UNKNOWN_DELAY_NS) * 1e-9


class ClockOffsets:
    """Intervals of clock offsets: positive if the other clock, or its stamps, are ahead."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # Both: heard longest ago first.
        self._authorities = BoundedMap[str, _Window](_MAX_ENTRIES)
        self._clients = BoundedMap[str, _Client](_MAX_ENTRIES)

    def put_arrived(self, authority: str, arrival_ns: int, newest_stamp_ns: int) -> None:
        """Add the newest stamp of a put, and when it arrived by this machine's real-time clock."""
        ahead_ns = newest_stamp_ns - arrival_ns
        with self._lock:
            window = self._authorities.get(authority)
            if window is None:
                self._authorities[authority] = _Window.of(arrival_ns, ahead_ns, ahead_ns)
            else:
                window.add(arrival_ns, ahead_ns, ahead_ns)
                self._authorities.move_to_end(authority)

    def add_client_clock(
        self, client: str, clock_ns: int, round_trip_ns: int = -1, of_ns: int = -1
    ) -> None:
        """Add a client's real-time clock when it sent a message that has arrived now.

        Args:
            client: The client's id.
            clock_ns: Its clock.
            round_trip_ns: How long such a message and its reply took. Negative: it does not know.
            of_ns: The clock in that message.
        """
        if not client or abs(clock_ns) >= 1 << 62:
            return
        now_ns = time.time_ns()
        with self._lock:
            known = self._clients.get(client)
            if known is not None:
                known.add(now_ns, clock_ns, round_trip_ns, of_ns)
            else:
                known = _Client(now_ns, clock_ns - now_ns, clock_ns)
            self._clients[client] = known

    def client_gone(self, client: str) -> None:
        """Forget a client that is not connected any more."""
        with self._lock:
            self._clients.pop(client, None)

    def add_to(self, records: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The authority records with what is known of each one's clock."""
        with self._lock:
            known = {name: _fields(window) for name, window in self._authorities.items()}
        nothing = dict.fromkeys(("clock_offset_min_s", "clock_offset_max_s", "stamp_age_s"))
        return [{**record, **known.get(record["name"], nothing)} for record in records]

    def client_records(self) -> list[dict[str, Any]]:
        """A record of each connected client that has sent its clock."""
        now_ns = time.time_ns()
        with self._lock:
            known = [(name, it.interval_s(), it.heard_ns) for name, it in self._clients.items()]
        return [
            {
                "client": name,
                "clock_offset_min_s": least,
                "clock_offset_max_s": greatest,
                "clock_age_s": max(0.0, (now_ns - heard_ns) * 1e-9),
            }
            for name, (least, greatest), heard_ns in known
        ]

    def worst_clients_s(self) -> tuple[float, float]:
        """By how much the client clock that leads most is ahead at least, and the one that lags
        most is behind at least; 0 if none is."""
        with self._lock:
            intervals = [client.interval_s() for client in self._clients.values()]
        ahead = max((least for least, _ in intervals), default=0.0)
        behind = max((-greatest for _, greatest in intervals), default=0.0)
        return max(0.0, ahead), max(0.0, behind)

    def suspicious(self) -> list[tuple[str, str]]:
        """Authorities and clients whose clock seems wrong: whose, and why. Those that are silent
        are left out."""
        heard_after_ns = time.time_ns() - 2 * WINDOW_NS
        with self._lock:
            heard = [
                (kind, name, one.interval_s())
                for kind, all_ in (("authority", self._authorities), ("client", self._clients))
                for name, one in all_.items()
                if one.heard_ns > heard_after_ns
            ]
        return [
            (f"{kind} {name!r}", reason)
            for kind, name, (least, greatest) in heard
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
    stamps = kind == "authority"
    what = "its stamps are" if stamps else "its clock is"
    if least_s > REPORT_S:
        return f"{what} {least_s:.1f} to {greatest_s:.1f} s ahead of this server's clock"
    if -_LONGEST_AGO_S < greatest_s < -REPORT_S:
        why = ": its clock is wrong, or its data is late" if stamps else ""
        return f"{what} {-greatest_s:.1f} to {-least_s:.1f} s behind this server's clock{why}"
    return None
