"""What the checks of the doctor read: plain facts, of a tree, a service or a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from zenoh_tf.introspection.explain import is_stopped, stopped_after_s
from zenoh_tf.introspection.frame_info import AuthorityInfo, ClientInfo, FrameInfo
from zenoh_tf.text.times import reference_ns
from zenoh_tf_tools.doctor.observation import Seen
from zenoh_tf_tools.doctor.timing import PAUSE_PERIODS, ArrivalPause

#: Rare events are reported for so long, though nobody observed them.
_RECENT_S: Final = 600.0
#: Stamps before 2001 are of a simulation.
SIMULATED_NS: Final = 10**18
#: Links whose pauses one is compared with.
_COMPARED: Final = 32


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """A frame, and what was observed of its link for some time. Unknown is ``None``.

    Attributes:
        frame: Its record at the end.
        before: Its record at the beginning of the observation.
        seen: Its samples.
    """

    frame: FrameInfo
    before: FrameInfo | None = None
    seen: Seen | None = None


@dataclass(frozen=True)
class TreeFacts:
    """What is known about a tree.

    Attributes:
        links: One for each frame.
        now_ns: The clock at the end, nanoseconds.
        observed_s: Seconds between ``before`` and the end.
        authorities: The publishers, at the end.
        authorities_before: The same at the beginning of the observation; empty if unknown.
        clients: The connected clients.
        is_complete: The counters are of all that was observed, as of a recording, which needs no
            ``before``.
    """

    links: Sequence[LinkFacts]
    now_ns: int
    observed_s: float = 0.0
    authorities: Sequence[AuthorityInfo] = ()
    authorities_before: Sequence[AuthorityInfo] = ()
    clients: Sequence[ClientInfo] = ()
    is_complete: bool = False

    def count(self, link: LinkFacts, counter: str) -> int:
        """Return by how much a counter has grown while it was observed, or what it is if nothing
        was observed.

        Args:
            link: One of the links.
            counter: The name of a field of `FrameInfo`.
        """
        grown = self.grown(link, counter)
        return int(getattr(link.frame, counter)) if grown is None else grown

    def grown(self, link: LinkFacts, counter: str) -> int | None:
        """Return by how much a counter has grown while it was observed; ``None``: unknown.

        Args:
            link: One of the links.
            counter: The name of a field of `FrameInfo`.
        """
        now: int = getattr(link.frame, counter)
        if self.is_complete:
            return now
        if not self.observed_s:
            return None
        if link.before is None:  # it came while it was observed
            return now
        before: int = getattr(link.before, counter)
        return max(0, now - before)  # a frame that was removed and came back restarts

    def ago_s(self, at_ns: int) -> float | None:
        """Return how long ago a rare event was, in seconds; ``None`` if that is too long.

        Args:
            at_ns: When it was, nanoseconds of the clock.
        """
        ago_s = (self.now_ns - at_ns) / 1e9
        return ago_s if not self.is_complete and -1.0 < ago_s < _RECENT_S else None

    def has_stopped(self, link: LinkFacts) -> bool:
        """Return whether a link's samples have ceased to come. Their stamps say so only if nothing
        else does, as a clock may be wrong.

        Args:
            link: One of the links.
        """
        limit_s = stopped_after_s(link.frame)
        if limit_s is None:
            return False
        last_ns = None if link.seen is None else link.seen.timing.last_ns
        if last_ns is not None:
            return self.now_ns - last_ns > limit_s * 1e9
        if not self.is_complete and self.grown(link, "version"):
            return False
        ahead_s = next(
            (
                publisher.clock_offset_max_s or 0.0
                for publisher in self.authorities
                if publisher.name == link.frame.authority
            ),
            0.0,  # how far the authority's clock is ahead is not known
        )
        return is_stopped(link.frame, self.reference[0] + round(1e9 * ahead_s))

    @cached_property
    def frames(self) -> dict[str, FrameInfo]:
        """The records of the frames by name."""
        return {link.frame.name: link.frame for link in self.links}

    @cached_property
    def dynamic(self) -> list[LinkFacts]:
        """The links that have stamps."""
        return [
            link
            for link in self.links
            if not link.frame.static and link.frame.newest_stamp_ns is not None
        ]

    @cached_property
    def seen(self) -> list[tuple[LinkFacts, Seen]]:
        """Those of the dynamic links whose samples were observed, with what was seen of them."""
        return [(link, link.seen) for link in self.dynamic if link.seen is not None]

    @cached_property
    def reference(self) -> tuple[int, bool]:
        """The time that ages are counted from, and whether it is the clock's."""
        stamps = (link.frame.newest_stamp_ns or 0 for link in self.dynamic)
        return reference_ns(stamps, self.now_ns)

    @cached_property
    def roots(self) -> dict[str, list[str]]:
        """The frames of each tree by its root. Frames without any link are in none."""
        parents = {frame.parent for frame in self.frames.values()}
        found: dict[str, list[str]] = {}
        for name, frame in self.frames.items():
            if frame.parent is not None or name in parents:
                found.setdefault(self.ancestors(name)[-1], []).append(name)
        return found

    def depth(self, name: str) -> int:
        """Return the number of links between a frame and its root.

        Args:
            name: The frame.
        """
        return len(self.ancestors(name)) - 1

    def ancestors(self, name: str) -> list[str]:
        """Return the frames from this one up to its root.

        Args:
            name: The frame.
        """
        path = dict.fromkeys([name])
        while (frame := self.frames.get(name)) is not None and frame.parent is not None:
            if frame.parent in path:  # gathered while the tree changed
                break
            name = frame.parent
            path[name] = None
        return [*path]

    def pauses(self, link: LinkFacts) -> list[ArrivalPause]:
        """Return the times in which no sample of a link came, without those in which no sample of
        any link did: then the network, the simulator or the recorder stood still.

        Args:
            link: One of the links.
        """
        return [
            pause
            for pause in ([] if link.seen is None else link.seen.timing.pauses)
            if not self.is_shared(link, pause)
        ]

    def is_shared(self, link: LinkFacts, pause: ArrivalPause, *, gaps_only: bool = False) -> bool:
        """Return whether all other links that are as fast paused at the same time.

        Args:
            link: One of the links.
            pause: One of its pauses.
            gaps_only: Pauses in which the stamps went on do not count, as of a simulator or a
                network that stood still.
        """
        others = [
            seen.timing
            for other, seen in self.seen
            if other is not link
            and (seen.timing.period_ns or pause.length_ns) * PAUSE_PERIODS < pause.length_ns
            and (seen.timing.last_ns or 0) >= pause.end_ns
        ][:_COMPARED]
        return bool(others) and all(
            any(
                2 * (min(p.end_ns, pause.end_ns) - max(p.start_ns, pause.start_ns))
                > pause.length_ns
                for p in timing.pauses
                if p.is_gap or not gaps_only
            )
            for timing in others
        )
