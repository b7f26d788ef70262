"""For how many robots the limits have room, and which one they would meet first.

A robot is assumed to have one connection, one authority and one mirror of its own, and to publish
60 frames, ten in a message. What it costs the processor is in docs/how-to/deploy.md.
"""

from __future__ import annotations

import math
import resource
from dataclasses import dataclass
from typing import Final

from .limits import Limits

_FRAMES: Final = 60
_FRAMES_PER_MESSAGE: Final = 10
#: A message of ten frames, with what its place in a queue costs.
_MESSAGE_BYTES: Final = 2000
#: That a tree has room for: the default of the core's options.
_AUTHORITIES: Final = 4096
#: A sample and its parent in the history.
_SAMPLE_BYTES: Final = 68
#: A history grows by doubling. Those that it had before take as much again, at most.
_GROWTH: Final = 2
#: Files that the server has open beside its connections.
_OWN_FILES: Final = 64
#: A system's own bound may be so high that programs which close every possible file hang.
_MOST_FILES: Final = 1 << 16
#: Rates of robots that are reported: of a site that follows many, and of a robot's own sensors.
_RATES_HZ: Final = (4, 100)


@dataclass(frozen=True, slots=True)
class Capacity:
    """How many robots the limits have room for."""

    robots: int
    #: The limit that the next robot would exceed: its name, or `open_files`.
    limit: str


def capacity(limits: Limits, cache_time_s: float, rate_hz: float, open_files: int) -> Capacity:
    """How many robots that send each frame at `rate_hz` there is room for. `open_files`: how many
    the process may have."""
    samples = 2 ** math.ceil(math.log2(cache_time_s * rate_hz + 2))
    history_bytes = min(samples, limits.samples_per_frame) * _SAMPLE_BYTES * _GROWTH
    messages_hz = rate_hz * _FRAMES / _FRAMES_PER_MESSAGE
    waiting = max(1.0, messages_hz * limits.put_wait_ms / 1000)
    rooms = {
        "connections": limits.connections,
        "open_files": max(0, open_files - _OWN_FILES),
        "authorities": _AUTHORITIES,
        "frames": limits.frames // _FRAMES,
        "memory": int(limits.memory // (history_bytes * _FRAMES)),
        "put_queues_bytes": int(limits.put_queues_bytes // (waiting * _MESSAGE_BYTES)),
        "pending_queries": limits.pending_queries,
        "interests": limits.interests,
        "interest_frames": limits.interest_frames // _FRAMES,
    }
    least = min(rooms, key=lambda name: rooms[name])
    return Capacity(rooms[least], least)


def report(limits: Limits, cache_time_s: float) -> str:
    """The line for the log."""
    open_files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    found = [capacity(limits, cache_time_s, rate, open_files) for rate in _RATES_HZ]
    parts = [
        f"{each.robots:,} at {rate} Hz ({each.limit} first)"
        for rate, each in zip(_RATES_HZ, found, strict=True)
    ]
    return f"the limits have room for robots of {_FRAMES} frames: {' or '.join(parts)}"


def allow_open_files() -> None:
    """Raise this process's bound of open files as far as the system lets it: a connection takes
    one, and 1,024 are usual."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < allowed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))
