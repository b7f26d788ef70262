"""A server's tree as it is now, read in a mirror."""

from __future__ import annotations

import time
from collections.abc import Sequence

from zenoh_tf import TransformException
from zenoh_tf.text.times import CLOCK_RANGE_S
from zenoh_tf_client.mirror.mirror import Mirror
from zenoh_tf_tools.viewer.source import Link, Lookups

#: From this age on, heartbeats are missing: a server sends ten a second.
_SILENT_S = 1.0


class LiveSource:
    """Shows the newest sample of each link."""

    range_ns: tuple[int, int] | None = None

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self._newest_ns = 0
        self._newest_since_s = 0.0  # when that was seen first, on the monotonic clock

    @property
    def lookups(self) -> Lookups:
        return self._mirror

    def names(self) -> list[str]:
        return self._mirror.frames()

    def link(self, name: str, time_ns: int) -> Link | None:
        try:
            frame = self._mirror.frame(name)
        except TransformException:
            return None
        newest_ns = frame.newest_stamp_ns
        return Link(
            name,
            frame.parent,
            frame.static,
            newest_ns,
            # A stamp ahead of the clock is a sample that has come already.
            None
            if frame.static or frame.parent is None or newest_ns is None
            else max(0.0, (time_ns - newest_ns) / 1e9),
            frame.rate_hz,
            frame.authority,
        )

    def now_ns(self, links: Sequence[Link]) -> int:
        """The clock, if the stamps are of it; else the newest stamp, and the time since it came."""
        stamps = [x.sample_ns for x in links if x.age_s is not None and x.sample_ns is not None]
        clock_ns = time.time_ns()
        newest_ns = max(stamps, default=clock_ns)
        if abs(clock_ns - newest_ns) <= CLOCK_RANGE_S * 10**9:
            return clock_ns
        if newest_ns != self._newest_ns:
            self._newest_ns, self._newest_since_s = newest_ns, time.monotonic()
        return newest_ns + int((time.monotonic() - self._newest_since_s) * 1e9)

    def trouble(self) -> str | None:
        age_s = self._mirror.age_s
        return None if age_s <= _SILENT_S else f"no heartbeat from the server for {age_s:.0f} s"
