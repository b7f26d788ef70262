"""`Observation`: gathers the samples of all links, as they come.

It serves recordings and served trees alike. Its memory does not grow with the samples: each link
keeps some, which are read and then dropped but for the last ones.

Thread safety: none.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from zenoh_tf_tools.doctor.motion import Motion
from zenoh_tf_tools.doctor.timing import NO_ARRIVAL, Chunk, Timing

#: Samples that are read at once, and those of them that the next ones are compared with.
_CHUNK: Final = 1024
_KEPT: Final = 256
#: A stamp that is so far from the one before, less the time that passed, is of another clock or of
#: another time: single ones are strays.
_STRAY_NS: Final = 5 * 10**9
#: Poses of a static link that differ by less are the same one, written in other digits.
_SAME: Final = 1e-6

Pose = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StaticReplacement:
    """A static link's value was replaced by another one.

    Attributes:
        count: How often.
        shift_m: How far the child moved the last time.
        turn_rad: How far it turned then.
        before: The authority, or a recording's topic, whose value was replaced.
        after: The one whose value it is now.
        is_milli: The length grew or shrank a thousand times.
    """

    count: int
    shift_m: float
    turn_rad: float
    before: str
    after: str
    is_milli: bool


@dataclass(slots=True)
class Seen:
    """What was seen of a link.

    Attributes:
        parent: Its parent, at last.
        static: Whether it was static, at last.
        pose: (7,) the last pose of child in parent.
        authority: Who sent it.
        timing: Of the samples while it was dynamic.
        motion: Of their poses.
        replaced: How its value as a static link was replaced; ``None``: never.
        norm_error: How far the norm of a received quaternion was from 1, at most.
    """

    parent: str
    static: bool
    pose: Pose
    authority: str
    timing: Timing = field(default_factory=Timing)
    motion: Motion = field(default_factory=Motion)
    replaced: StaticReplacement | None = None
    norm_error: float = 0.0


class Observation:
    """Gathers what is seen of each link."""

    def __init__(self) -> None:
        self._links: dict[str, _ObservedLink] = {}
        #: The first and the last arrival, nanoseconds.
        self.first_ns: int | None = None
        self.last_ns = 0

    def load(self, child: str, parent: str, stamps: NDArray[np.int64], poses: Pose) -> None:
        """Add the history that a dynamic link had before.

        Args:
            child: The link's child.
            parent: Its parent.
            stamps: (n,) nanoseconds, sorted; at least one.
            poses: (n, 7) of child in parent.
        """
        if child not in self._links:
            self._links[child] = link = _ObservedLink(parent, False, poses[-1], "")
            link.load(stamps[-_CHUNK:], poses[-_CHUNK:])

    def add(
        self,
        arrival_ns: int | None,
        child: str,
        parent: str,
        stamp_ns: int,
        pose: Pose,
        authority: str,
        *,
        static: bool,
    ) -> Seen:
        """Add a sample, and return what was seen of its link.

        Args:
            arrival_ns: When it came, nanoseconds; ``None``: a static link that was there before.
            child: The link's child.
            parent: Its parent.
            stamp_ns: Its stamp.
            pose: (7,) of child in parent.
            authority: Who sent it.
            static: It holds at all times.
        """
        if arrival_ns is not None:
            self.came(arrival_ns)
        link = self._links.get(child)
        if link is None:
            self._links[child] = link = _ObservedLink(parent, static, pose, authority)
        elif parent != link.seen.parent or static != link.seen.static:
            link.restart()
        elif static:
            link.replace(pose, authority)
        seen = link.seen
        seen.parent, seen.static, seen.pose, seen.authority = parent, static, pose, authority
        if arrival_ns is not None and not static:
            link.add(arrival_ns, stamp_ns, pose)
        return seen

    def renew(self) -> None:
        """Judge what comes from now on. What came before is only compared with it."""
        for link in self._links.values():
            link.renew()

    def came(self, arrival_ns: int) -> None:
        """Record that the clock of the arrivals has reached a time.

        Args:
            arrival_ns: Nanoseconds.
        """
        self.first_ns = arrival_ns if self.first_ns is None else self.first_ns
        self.last_ns = max(self.last_ns, arrival_ns)

    def seen(self) -> dict[str, Seen]:
        """Return what was seen of each link, by its child."""
        for link in self._links.values():
            link.read()
        return {child: link.seen for child, link in self._links.items()}


class _ObservedLink:
    """The samples of a link that were not read yet, and those that the next are compared with."""

    def __init__(self, parent: str, static: bool, pose: Pose, authority: str) -> None:
        self.seen = Seen(parent, static, pose, authority)
        self._loaded: frozenset[int] = frozenset()
        self._arrivals: list[int] = []
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._fresh = 0  # the samples before this one were read
        self._stray_ns: int | None = None

    def load(self, stamps: NDArray[np.int64], poses: Pose) -> None:
        self._stamps = stamps.tolist()
        self._poses = [*poses]
        self._arrivals = [NO_ARRIVAL] * len(stamps)
        self._loaded = frozenset(self._stamps)

    def add(self, arrival_ns: int, stamp_ns: int, pose: Pose) -> None:
        timing = self.seen.timing
        timing.arrivals += 1
        timing.last_ns = max(arrival_ns, timing.last_ns or arrival_ns)
        if stamp_ns in self._loaded:  # the stream may repeat what the snapshot has
            return
        if self._is_stray(arrival_ns, stamp_ns):
            if self._stray_ns is None or abs(stamp_ns - self._stray_ns) > _STRAY_NS:
                self._stray_ns = stamp_ns
                timing.strays += 1
                timing.stray_lead_ns = max(timing.stray_lead_ns, stamp_ns - arrival_ns)
                return
            timing.strays -= 1  # two that agree are a new beginning
            self.restart()
        self._stray_ns = None
        self._arrivals.append(arrival_ns)
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        if len(self._stamps) >= _CHUNK:
            self.read()

    def _is_stray(self, arrival_ns: int, stamp_ns: int) -> bool:
        if not self._stamps:
            return False
        passed = stamp_ns - self._stamps[-1]
        if self._arrivals[-1] != NO_ARRIVAL:
            passed -= arrival_ns - self._arrivals[-1]
        elif passed > 0:  # the time between history and first arrival is not known
            return stamp_ns - arrival_ns > _STRAY_NS and passed > _STRAY_NS
        return abs(passed) > _STRAY_NS

    def read(self) -> None:
        """Read what has come, and keep some for comparison."""
        if len(self._stamps) == self._fresh:
            return
        chunk = Chunk(
            np.array(self._arrivals, np.int64),
            np.array(self._stamps, np.int64),
            np.array(self._poses, np.float64),
            self._fresh,
        )
        self.seen.timing.read(chunk)
        self.seen.motion.read(chunk)
        for kept in (self._arrivals, self._stamps, self._poses):
            del kept[:-_KEPT]
        self._fresh = len(self._stamps)

    def renew(self) -> None:
        """Forget what the samples say, but not when the last one came."""
        self.read()
        seen, timing = self.seen, Timing(last_ns=self.seen.timing.last_ns)
        self.seen = Seen(seen.parent, seen.static, seen.pose, seen.authority, timing)

    def restart(self) -> None:
        """Forget the samples: the next ones are of another parent, kind or time."""
        self.read()
        self._arrivals, self._stamps, self._poses, self._fresh = [], [], [], 0

    def replace(self, pose: Pose, authority: str) -> None:
        """Compare a static link's value with the one before."""
        seen = self.seen
        shift_m = float(np.linalg.norm(pose[:3] - seen.pose[:3]))
        turn = 2 * np.arccos(min(1.0, abs(float(pose[3:] @ seen.pose[3:]))))
        if shift_m <= _SAME and turn <= _SAME:
            return
        lengths = sorted(float(np.linalg.norm(p[:3])) for p in (pose, seen.pose))
        is_milli = lengths[0] > 0.01 and 700 < lengths[1] / lengths[0] < 1400
        count = 1 if seen.replaced is None else seen.replaced.count + 1
        seen.replaced = StaticReplacement(
            count, shift_m, float(turn), seen.authority, authority, is_milli
        )
