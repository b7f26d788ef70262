"""A server's tree as it is now, read in a mirror."""

from __future__ import annotations

import time
from collections.abc import Sequence

from zenoh_tf import FrameInfo, TransformException
from zenoh_tf.text.times import CLOCK_RANGE_S
from zenoh_tf_client.mirror.mirror import Mirror
from zenoh_tf_tools.viewer.source import Lookups, ViewedLink

#: A step of links that have no rate.
_STEP_NS = 100_000_000
#: From this age on, heartbeats are missing: a server sends ten a second.
_SILENT_S = 1.0


class LiveSource:
    """Shows the newest sample of each link, or, while it is paused, the last seconds."""

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

    def link(self, name: str, time_ns: int, *, past: bool = False) -> ViewedLink | None:
        frame = self._find(name)
        if frame is None:
            return None
        parent, newest_ns = frame.parent, frame.newest_stamp_ns
        sample_ns = newest_ns
        if past and newest_ns is not None and not frame.static:
            sample_ns = min(newest_ns, time_ns)
            try:
                parent = self._mirror.parent(name, sample_ns)
            except TransformException:  # the frame is gone, or has no sample as old
                return None
        return ViewedLink(
            name,
            parent,
            frame.static,
            sample_ns,
            # A stamp ahead of the clock is a sample that has come already.
            None
            if frame.static or parent is None or newest_ns is None
            else max(0.0, (time_ns - newest_ns) / 1e9),
            frame.rate_hz,
            frame.authority,
        )

    def now_ns(self, links: Sequence[ViewedLink]) -> int:
        """The clock, if the stamps are of it; else the newest stamp, and the time since it came."""
        stamps = [x.sample_ns for x in links if x.age_s is not None and x.sample_ns is not None]
        clock_ns = time.time_ns()
        newest_ns = max(stamps, default=clock_ns)
        if is_clock(newest_ns):
            return clock_ns
        if newest_ns != self._newest_ns:
            self._newest_ns, self._newest_since_s = newest_ns, time.monotonic()
        return newest_ns + int((time.monotonic() - self._newest_since_s) * 1e9)

    def step_ns(self, names: Sequence[str], time_ns: int, step: int) -> int:
        """So many periods of the fastest link on, no further than the links have samples."""
        frames = [frame for name in names if (frame := self._find(name)) and not frame.static]
        rates = [frame.rate_hz for frame in frames if frame.rate_hz]
        period_ns = round(1e9 / max(rates)) if rates else _STEP_NS
        oldest_ns = max((x.oldest_stamp_ns for x in frames if x.oldest_stamp_ns), default=time_ns)
        newest_ns = max((x.newest_stamp_ns for x in frames if x.newest_stamp_ns), default=time_ns)
        return min(max(time_ns + step * period_ns, oldest_ns), max(newest_ns, oldest_ns))

    def spans_ns(self, name: str) -> list[tuple[int, int]]:
        return []

    def _find(self, name: str) -> FrameInfo | None:
        try:
            return self._mirror.frame(name)
        except TransformException:
            return None

    def trouble(self) -> str | None:
        age_s = self._mirror.age_s
        return None if age_s <= _SILENT_S else f"no heartbeat from the server for {age_s:.0f} s"


def is_clock(time_ns: int) -> bool:
    """Return whether a time is of the clock, not of a simulation."""
    return abs(time.time_ns() - time_ns) <= CLOCK_RANGE_S * 10**9
