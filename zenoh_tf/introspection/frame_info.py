"""Introspection: frames, their links, the authorities that write them, and connected clients."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from typing_extensions import Self

#: Two bits of a version are the lock's (`zenoh_tf/core/records/lock_words.hpp`).
_VERSIONS_PER_COMMIT: Final = 4
#: Samples of less show no rate.
_LEAST_SPAN_NS: Final = 100_000_000


#: Stamps that lead the clock by less are no sign of a wrong one: it is the delay of messages.
AHEAD_S: Final = 0.1
#: A localisation stamps its corrections ahead by less than this (AMCL: 1 s).
_POST_DATED_S: Final = 2.0


def is_post_dated(lead_s: float, leads_below_s: Iterable[float]) -> bool:
    """Return whether stamps may lead on purpose: a localisation such as AMCL stamps ahead its
    corrections of an odometry whose stamps are not ahead.

    Args:
        lead_s: By how much the newest stamp of the link leads the clock, seconds.
        leads_below_s: The same of the dynamic links whose parent is the link's child.
    """
    return AHEAD_S < lead_s < _POST_DATED_S and any(below_s < AHEAD_S for below_s in leads_below_s)


@dataclass(frozen=True, slots=True)
class FrameChange:
    """The last change of a frame's link. tf2 makes such changes silently.

    Attributes:
        kind: ``reparented``: the newest parent changed. ``switched``: the link went from static to
            dynamic or back. ``authority``: only the authority that writes it changed.
        stamp_ns: Stamp in nanoseconds of the transform that changed the link.
        authority: Authority that wrote it.
        parent_before: Parent before the change.
        static_before: Whether the link was static before the change.
        authority_before: The authority that had written it.
        pose_before: Its newest pose before the change, of the child in ``parent_before``: x, y, z
            in metres and the quaternion's x, y, z, w. Empty if a server does not send it.
    """

    kind: Literal["reparented", "switched", "authority"]
    stamp_ns: int
    authority: str
    parent_before: str | None
    static_before: bool
    authority_before: str = ""
    pose_before: Sequence[float] = field(default=(), compare=False)


@dataclass(frozen=True, slots=True)
class Replacement:
    """The last time that a static link's value was replaced by another one.

    Attributes:
        count: How often a value was replaced until then.
        at_ns: When, in nanoseconds of the real-time clock of the server, or of this machine for an
            embedded tree.
        shift_m: How far the child moved.
        turn_rad: How far it turned.
        authority_before: The authority whose value was replaced.
    """

    count: int
    at_ns: int
    shift_m: float
    turn_rad: float
    authority_before: str


@dataclass(frozen=True, slots=True)
class TimeJump:
    """The last time that a link's history was cleared because time was set back.

    Attributes:
        at_ns: When, in nanoseconds of the real-time clock of the server, or of this machine for an
            embedded tree.
        newest_stamp_ns: The newest stamp of the history that was cleared.
    """

    at_ns: int
    newest_stamp_ns: int


FramePart = FrameChange | Replacement | TimeJump
#: The fields of a frame's record that are maps themselves.
PARTS: Final[dict[str, type[FramePart]]] = {
    "last_change": FrameChange,
    "last_replacement": Replacement,
    "last_time_jump": TimeJump,
}


@dataclass(frozen=True, slots=True, repr=False)
class FrameInfo:
    """A frame and the link to its parent, as of one instant.

    Attributes:
        name: The frame.
        parent: Its parent; ``None`` for a root.
        authority: Authority that wrote the link last; empty if it gave no name.
        static: Whether the link holds at all times.
        samples: Samples in the history; 1 for a static link, 0 without data.
        oldest_stamp_ns: Oldest stamp in nanoseconds; ``None`` without data.
        newest_stamp_ns: Newest stamp in nanoseconds; ``None`` without data.
        version: Number that grows with every change of the frame.
        rewritten: Samples replaced at an equal stamp.
        dropped: Transforms dropped as too old.
        evicted: Samples evicted before the cache time because the link was full.
        reparented: Changes of the newest parent.
        switched: Changes between static and dynamic.
        authority_changes: Changes of the authority.
        time_jumps: Times that the history started over because time was set back, or jumped ahead.
        last_change: The latest of these three kinds of change; ``None`` if there was none.
        last_replacement: The last time that a static value was replaced by another one; ``None``
            if none was since the link was cleared.
        last_time_jump: The last of the times that the history started over; ``None`` if there
            was none since the link was cleared.
        late_failures: Lookups by query that failed because they asked for a time before the link's
            sample had come; always 0 for an embedded tree.
        late_waits: Lookups that waited for such a sample, and got their answer.
        late_ns: By how many nanoseconds, in the sum of both, the times asked for were newer than
            the newest sample.
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
    time_jumps: int = 0
    last_replacement: Replacement | None = None
    last_time_jump: TimeJump | None = None
    late_failures: int = 0
    late_waits: int = 0
    late_ns: int = 0

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Self:
        """Return the instance of a map of the fields, as it is sent over the network.

        Args:
            record: Values by field name.
        """
        parts: dict[str, Any] = {}
        for name, kind in PARTS.items():
            part = record.get(name)
            parts[name] = None if part is None else kind(**part)
        return cls(**{**record, **parts})

    @property
    def commits(self) -> int:
        """Count of commits that changed the frame. Compare two: a new frame need not begin at 0."""
        return self.version // _VERSIONS_PER_COMMIT

    @property
    def rate_hz(self) -> float | None:
        """Samples per second between oldest and newest, as tf2 counts; ``None`` without a rate.

        Samples of less than 0.1 s show none: all of them may be of one transaction.
        """
        if self.static or self.oldest_stamp_ns is None or self.newest_stamp_ns is None:
            return None
        span_ns = self.newest_stamp_ns - self.oldest_stamp_ns
        return self.samples * 1e9 / span_ns if span_ns >= _LEAST_SPAN_NS else None

    def __repr__(self) -> str:
        link = "a root" if self.parent is None else f"in {self.parent!r}"
        if self.parent is not None:
            newest = "static" if self.static else f"newest_stamp_ns={self.newest_stamp_ns}"
            link += f", {newest}, samples={self.samples}, authority={self.authority!r}"
        return f"<FrameInfo {self.name!r} {link}>"

    def delay_s(self, now_ns: int | None = None) -> float | None:
        """Return how many seconds the newest sample lies behind now: tf2's transform delay.

        Args:
            now_ns: The time to compare with, nanoseconds; None means this machine's clock.

        Returns:
            Seconds, negative if the stamp lies ahead; ``None`` for a static link or no data.
        """
        if self.static or self.newest_stamp_ns is None:
            return None
        return ((time.time_ns() if now_ns is None else now_ns) - self.newest_stamp_ns) * 1e-9


@dataclass(frozen=True, slots=True)
class AuthorityInfo:
    """What an authority has done in the tree's lifetime. Commits without a name do not count.

    Attributes:
        name: The authority.
        frames: Frames whose newest sample it wrote.
        commits: Its commits, published or called.
        stored: Transforms in them that were stored.
        dropped: Transforms in them that were older than the cache time, and dropped.
        rewritten: Stored transforms that replaced a sample at an equal stamp.
        conflicts: Times that it took over a frame which another authority had written.
        refused: Transforms in published messages that the server refused, while it stored the
            others of these messages; a message that it could not parse counts as one. A refused
            call raises an error and is not counted, so this is always 0 for an embedded tree.
        last_refusal: Why the server refused the last of these transforms, with their frames;
            ``None``: it has refused none since the tree was reset.
        dropped_by_queue: Published messages that the server dropped because too many of this
            authority were waiting, or had waited for too long.
        clock_offset_min_s: Least of its stamps' lead over their arrival at the server, over the
            last 10 to 20 s: negative for stamps that are older. ``None``: it published nothing.
        clock_offset_max_s: Greatest lead. It has the least delay in it: the authority's clock is
            ahead of the server's by this much or more.
        stamp_age_s: How old the newest stamp of its last message was on arrival.
        mirror_lost_s: Of a robot whose tree the server mirrors (``--mirror-of``): for how many
            seconds nothing has come from its server. ``None``: it is connected, or no such robot's.
        refused_by_reason: The transforms of ``refused`` by reason, such as ``not_finite`` or
            ``empty_name``; the documentation of the metrics lists all.
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
    dropped_by_queue: int = 0
    clock_offset_min_s: float | None = None
    clock_offset_max_s: float | None = None
    stamp_age_s: float | None = None
    mirror_lost_s: float | None = None
    refused_by_reason: Mapping[str, int] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class ClientInfo:
    """A client that is connected to the server, and how far its clock is from the server's.

    Attributes:
        client: Its Zenoh id, which the server's log names.
        clock_offset_min_s: Its real-time clock is ahead of the server's by this much at least,
            in seconds; negative for a clock that is behind.
        clock_offset_max_s: It is ahead by this much at most; until its second message, if the
            first took less than a second.
        clock_age_s: How long ago the clock was compared last, in seconds. A client sends it when
            it connects, and every 10 s while it makes calls.
        address: Where its link comes from, such as ``tcp/10.0.0.7:50312``; ``None`` if it is
            connected through a router.
    """

    client: str
    clock_offset_min_s: float
    clock_offset_max_s: float
    clock_age_s: float
    address: str | None = None
