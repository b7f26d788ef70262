"""What the viewer draws from: links at a time, and lookups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from zenoh_tf import TransformTree
from zenoh_tf_client.mirror.mirror import Mirror


@dataclass(frozen=True, slots=True)
class ViewedLink:
    """A frame and the link to its parent, at a time.

    Attributes:
        name: The frame.
        parent: Its parent; None for a root.
        static: Whether the link holds at all times.
        sample_ns: The time of the history, in nanoseconds, that its pose is looked up at: the
            nearest one to the time asked for that the history has. None without data.
        age_s: How many seconds before the time the newest sample is; negative if the first sample
            comes after it. None for static links and roots.
        rate_hz: Samples per second; None if there is no rate.
        authority: Who published it.
    """

    name: str
    parent: str | None
    static: bool
    sample_ns: int | None
    age_s: float | None
    rate_hz: float | None
    authority: str

    def is_stale(self, after_s: float) -> bool:
        """Return whether its newest sample is older than this."""
        return self.age_s is not None and self.age_s > after_s

    @property
    def is_awaited(self) -> bool:
        """Whether its first sample comes later."""
        return self.age_s is not None and self.age_s < 0


#: What answers lookups.
Lookups = TransformTree | Mirror


class ViewedTree(Protocol):
    """A tree to show. Only the viewer's thread calls it."""

    @property
    def range_ns(self) -> tuple[int, int] | None:
        """The times that can be chosen, in nanoseconds; None: only now."""

    @property
    def lookups(self) -> Lookups: ...

    def names(self) -> list[str]:
        """All frames, in any order."""

    def link(self, name: str, time_ns: int, *, past: bool = False) -> ViewedLink | None:
        """A frame's link at a time; None if there is no such frame any more.

        Args:
            name: The frame.
            time_ns: The time, in nanoseconds.
            past: Whether the time was chosen. Else a live tree shows the newest samples.
        """

    def now_ns(self, links: Sequence[ViewedLink]) -> int:
        """The time to show next; `links`: those of the last time."""

    def step_ns(self, names: Sequence[str], time_ns: int, step: int) -> int:
        """The time of the next sample of these frames, or if `step` is -1 of the one before, in
        nanoseconds; `time_ns` itself if there is none. Of a live tree, `step` 0 is the nearest
        time that has samples."""

    def spans_ns(self, name: str) -> list[tuple[int, int]]:
        """The times between which a frame has samples without a long pause, in nanoseconds; none
        for a frame without stamps, and of a live tree."""

    def trouble(self) -> str | None:
        """Why what is shown may be out of date or incomplete; None if all is well."""
