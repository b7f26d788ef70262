"""What the checks of the doctor read: plain facts, of a tree, a service or a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from zenoh_tf.introspection.frame_info import AuthorityInfo, ClientInfo, FrameInfo
from zenoh_tf.text.times import reference_ns


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """A frame, and what was observed of its link for some time. Unknown is ``None``.

    Attributes:
        frame: Its record at the end.
        before: Its record at the beginning of the observation.
        longest_gap_s: The longest time in which no sample came.
        norm_error: How far the norm of a received quaternion was from 1, at most. A tree
            normalises what it stores, so only messages show it.
        received: How many samples there were in all.
    """

    frame: FrameInfo
    before: FrameInfo | None = None
    longest_gap_s: float | None = None
    norm_error: float | None = None
    received: int | None = None


@dataclass(frozen=True)
class TreeFacts:
    """What is known about a tree.

    Attributes:
        links: One for each frame.
        now_ns: The clock at the end, nanoseconds.
        observed_s: Seconds between ``before`` and the end.
        authorities: The publishers.
        clients: The connected clients.
        is_complete: The counters are of all that was observed, as of a recording, which needs no
            ``before``.
    """

    links: Sequence[LinkFacts]
    now_ns: int
    observed_s: float = 0.0
    authorities: Sequence[AuthorityInfo] = ()
    clients: Sequence[ClientInfo] = ()
    is_complete: bool = False

    def grown(self, link: LinkFacts, counter: str) -> int | None:
        """Return by how much a counter has grown while it was observed; ``None``: unknown.

        Args:
            link: One of the links.
            counter: The name of a field of `FrameInfo`.
        """
        now: int = getattr(link.frame, counter)
        if self.is_complete:
            return now
        if link.before is None:
            return None
        before: int = getattr(link.before, counter)
        return max(0, now - before)  # a frame that was removed and came back restarts

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
                found.setdefault(self._ancestors(name)[-1], []).append(name)
        return found

    def depth(self, name: str) -> int:
        """Return the number of links between a frame and its root.

        Args:
            name: The frame.
        """
        return len(self._ancestors(name)) - 1

    def _ancestors(self, name: str) -> list[str]:
        path = dict.fromkeys([name])
        while (frame := self.frames.get(name)) is not None and frame.parent is not None:
            if frame.parent in path:  # gathered while the tree changed
                break
            name = frame.parent
            path[name] = None
        return [*path]


class Gaps:
    """Finds the longest time without a sample of each link, from records read again and again.

    Between two records of one version nothing was committed, however late the second was read. So
    a reader that is held up finds no gap that was not there.
    """

    def __init__(self) -> None:
        self._since: dict[str, tuple[int, float]] = {}  # the version, and when it was read first
        self._longest: dict[str, float] = {}

    def saw(self, frames: Iterable[FrameInfo], at_s: float) -> None:
        """Record a reading.

        Args:
            frames: The records.
            at_s: When they were asked for, in seconds of any clock that does not jump.
        """
        for frame in frames:
            version, since_s = self._since.get(frame.name, (None, at_s))
            if version == frame.version:
                longest_s = self._longest.get(frame.name, 0.0)
                self._longest[frame.name] = max(longest_s, at_s - since_s)
            else:
                self._since[frame.name] = (frame.version, at_s)

    def longest_s(self, frame: str) -> float | None:
        """Return the longest gap in seconds; ``None`` if there was none to be seen.

        Args:
            frame: The child of the link.
        """
        return self._longest.get(frame)
