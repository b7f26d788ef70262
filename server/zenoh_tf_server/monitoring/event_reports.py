"""Reports what happens to frames and clocks: time jumps, late samples, conflicts, wrong clocks.

The core records events where they happen, without waiting for a log. One thread fetches them
twice a second, and logs them by name and at a bounded rate.

Thread safety: all methods.
"""

from __future__ import annotations

import logging
from typing import Any, Final

from zenoh_tf import TransformTree
from zenoh_tf.text import quoted
from zenoh_tf.threads import Periodic

from ..ingest.clock_offsets import ClockOffsets
from ..rate_limited_log import RateLimitedLog

_INTERVAL_S: Final = 0.5
#: A clock that stays wrong is reported again after this long.
_CLOCK_PERIOD_S: Final = 60.0
#: A frame whose authority or parent changes this often between two reports is in dispute.
_DISPUTE: Final = 2


class EventReports(Periodic):
    def __init__(self, tree: TransformTree, clocks: ClockOffsets) -> None:
        logger = logging.getLogger("zenoh_tf.server.events")
        self._tree = tree
        self._clocks = clocks
        self._log = RateLimitedLog(logger)
        self._clock_log = RateLimitedLog(logger, _CLOCK_PERIOD_S)
        super().__init__("event-reports", self._report, _INTERVAL_S, at_end=True)

    def _report(self) -> None:
        events, lost = self._tree._take_events()
        for event in events:
            reason = _describe(event)
            if reason is not None:
                self._log.warn(f"frame {quoted(event['frame'])}: {event['kind']}", reason)
        if lost:
            self._log.warn("events", f"{lost:,} more events of other frames are not shown")
        for name, reason in self._clocks.suspicious():
            self._clock_log.warn(name, reason)


def _describe(event: dict[str, Any]) -> str | None:
    """What a log line says of an event; None: nothing."""
    who, count = quoted(event["authority"]), event["count"]
    times = "" if count == 1 else f" ({count:,} times)"
    match event["kind"]:
        case "late":
            return (
                f"{who} sent a stamp, {event['stamp_ns']} ns, that is older than the newest one, "
                f"{event['newest_stamp_ns']} ns, by more than the cache time: not stored{times}"
            )
        case "time_jump":
            side = "before" if event["stamp_ns"] < event["newest_stamp_ns"] else "after"
            return (
                f"{who} continued at {event['stamp_ns']} ns, far {side} the newest stamp, "
                f"{event['newest_stamp_ns']} ns: the frame's history was cleared and begins "
                f"again there{times}"
            )
        case "conflict":
            before = quoted(event["authority_before"])
            if count < _DISPUTE:
                return f"{who} took it over from {before}"
            return f"{who} and {before} both publish it: it changed hands {count:,} times"
        case _ if count >= _DISPUTE:
            parents = f"{quoted(event['parent_before'])} and {quoted(event['parent'])}"
            return f"{who} and others flip its parent between {parents}{times}"
    return None  # a new parent is what happens to an object that is picked up
