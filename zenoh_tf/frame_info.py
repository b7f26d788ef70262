"""What the tree knows about its frames, and about who writes them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal, Self


@dataclass(frozen=True, slots=True)
class FrameChange:
    """The last time that a frame's link became another: its newest parent changed
    (``reparented``), it went from static to dynamic or back (``switched``), or only another
    authority took it over (``authority``). tf2 does all three silently.

    ``authority`` did it, with a transform stamped ``stamp_ns``; ``parent_before`` and
    ``static_before`` tell what the link was.
    """

    kind: Literal["reparented", "switched", "authority"]
    stamp_ns: int
    authority: str
    parent_before: str | None
    static_before: bool


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """A frame and the link to its parent, as of one instant.

    ``parent`` is ``None`` for a root, and the stamps are ``None`` where there is no data.
    A static link has one sample, good for all times. The counters: samples ``rewritten`` at an
    equal stamp, ``dropped`` as too old, ``evicted`` before their time because the frame was
    full; times the newest link was ``reparented``, ``switched`` between static and dynamic,
    taken over by another authority (``authority_changes``); ``last_change`` is the latest of
    these three.
    """

    name: str
    parent: str | None
    authority: str
    static: bool
    samples: int
    oldest_stamp_ns: int | None
    newest_stamp_ns: int | None
    version: int
    rewritten: int
    dropped: int
    evicted: int
    reparented: int
    switched: int
    authority_changes: int
    last_change: FrameChange | None

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Self:
        """From the map of the fields, as it travels."""
        change = record["last_change"]
        return cls(**{**record, "last_change": None if change is None else FrameChange(**change)})

    @property
    def rate_hz(self) -> float | None:
        """Samples over the time between oldest and newest, as tf2 counts; ``None``: no rate."""
        if self.static or self.oldest_stamp_ns is None or self.newest_stamp_ns is None:
            return None
        span_ns = self.newest_stamp_ns - self.oldest_stamp_ns
        return self.samples * 1e9 / span_ns if span_ns > 0 else None

    def delay_s(self, now_ns: int | None = None) -> float | None:
        """How far the newest sample is behind ``now_ns`` (default: this machine's clock), in
        seconds; ``None`` for a static link or no data. tf2's transform delay."""
        if self.static or self.newest_stamp_ns is None:
            return None
        return ((time.time_ns() if now_ns is None else now_ns) - self.newest_stamp_ns) * 1e-9


@dataclass(frozen=True, slots=True)
class AuthorityInfo:
    """What an authority has done since the tree exists. Commits without one are not counted.

    Attributes:
        name: The authority.
        frames: Frames whose newest sample it wrote.
        commits: Its commits, published or called.
        stored: Transforms in them that were stored.
        dropped: Transforms in them that were older than the cache time, and dropped.
        rewritten: Stored transforms that replaced a sample at an equal stamp.
        conflicts: Times that it took over a frame which another authority had written.
        refused: Transforms in published messages that the server refused; a message that it
            could not parse counts as one. A refused call raises an error and is not counted,
            so this is always 0 for an embedded tree.
        last_refusal: Why the server refused the last of these messages; ``None``: none was.
    """

    name: str
    frames: int
    commits: int
    stored: int
    dropped: int
    rewritten: int
    conflicts: int
    refused: int = 0
    last_refusal: str | None = None
