"""What a watch reports of the pose of a pair of frames, and when; it does not wait.

Thread safety: none; the owner locks.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final, Literal

from zenoh_tf import LatestTransform, Transform
from zenoh_tf.errors import ConnectivityException, LookupException, ServerUnavailable, must_be

from .mirror import Mirror

#: Bounds of `heartbeat_s`.
_SHORTEST_S: Final = 0.01
_LONGEST_S: Final = 3600.0


@dataclass(frozen=True, slots=True)
class PoseEvent:
    """The pose of a pair as it is now, and why it is reported.

    A pose that stands still comes as heartbeats with a small age. If the server is away, they come
    with a growing age: nobody knows whether the pose has changed.

    Attributes:
        reason: `"found"`: the lookup succeeds, for the first time or again. `"moved"`: the pose has
            left the dead-band. `"lost"`: the lookup fails. `"heartbeat"`: nothing of these for
            `heartbeat_s`.
        pose: ``X_target_source`` of the newest sample of every link, in metres; None while the
            lookup fails.
        error: The error of the lookup while it fails: a LookupException or ConnectivityException.
        age_s: How old this may be, in seconds: all that the server had committed that long ago is
            in it.
    """

    reason: Literal["found", "moved", "heartbeat", "lost"]
    pose: LatestTransform | None
    error: LookupException | ConnectivityException | None
    age_s: float


@dataclass(frozen=True, slots=True)
class Terms:
    """When a watch reports; raises InvalidArgumentException if a value is out of range."""

    min_translation_m: float
    min_rotation_rad: float
    heartbeat_s: float

    def __post_init__(self) -> None:
        for field in ("min_translation_m", "min_rotation_rad"):
            if not getattr(self, field) >= 0:
                raise must_be(field, "0 or more", getattr(self, field))
        if not _SHORTEST_S <= self.heartbeat_s <= _LONGEST_S:
            limits = f"from {_SHORTEST_S:g} to {_LONGEST_S:g}"
            raise must_be("heartbeat_s", limits, self.heartbeat_s)

    def is_outside(self, last: Transform, now: Transform) -> bool:
        """Whether a pose is outside the dead-band around the last one."""
        if last == now:
            return False
        old, new = last.pose(), now.pose()
        return (
            math.dist(old[:3], new[:3]) > self.min_translation_m
            or _angle(old[3:], new[3:]) > self.min_rotation_rad
        )


def _angle(p: tuple[float, ...], q: tuple[float, ...]) -> float:
    """The angle of the rotation between two, in radians; unit quaternions (x, y, z, w)."""
    # The difference and the sum of the two are as long as 2 sin and 2 cos of a quarter of it. Small
    # angles keep their digits, and equal quaternions have none.
    apart, along = math.dist(p, q), math.hypot(*(a + b for a, b in zip(p, q, strict=True)))
    return 4 * math.atan2(min(apart, along), max(apart, along))


class Watching:
    """Compares what a mirror has now with what was reported last."""

    def __init__(self, mirror: Mirror, target: str, source: str, terms: Terms) -> None:
        self._mirror = mirror
        self._pair = (target, source)
        self._terms = terms
        self._last: Transform | None = None  # of the last event but heartbeats; None: lost
        self._begun = False
        self._reported_s = 0.0

    @property
    def heartbeat_in_s(self) -> float:
        """How long from now until a heartbeat is due, in seconds."""
        return max(0.0, self._reported_s + self._terms.heartbeat_s - time.monotonic())

    def next_event(self) -> PoseEvent | None:
        """The event to report now; None if there is none, or the mirror is closed."""
        pose: LatestTransform | None = None
        failed: LookupException | ConnectivityException | None = None
        try:
            pose = self._mirror._tree.lookup_latest_transform_xact(*self._pair)
        except (LookupException, ConnectivityException) as error:
            failed = error.with_traceback(None)  # its frames would keep all of this alive
        except ServerUnavailable:
            return None
        last, now = self._last, pose.transform if pose else None
        reason: Literal["found", "moved", "heartbeat", "lost"]
        if now is None and (last is not None or not self._begun):
            reason = "lost"
        elif now is not None and last is None:
            reason = "found"
        elif now is not None and last is not None and self._terms.is_outside(last, now):
            reason = "moved"
        elif not self.heartbeat_in_s:
            reason = "heartbeat"
        else:
            return None
        if reason != "heartbeat":  # or a slow drift would never leave the dead-band
            self._last = now
        self._begun = True
        self._reported_s = time.monotonic()
        return PoseEvent(reason, pose, failed, self._mirror.age_s)
