"""The lookups of mirrors that never wait: those of the embedded tree.

While there is a copy, the methods here are not called: the mirror has the tree's own methods as
attributes, because a call of Python's in between would cost half as much as a lookup.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import (
    Estimate,
    EstimateArray,
    Explanation,
    FrameInfo,
    TransformArray,
    TransformTree,
    Velocity,
)
from zenoh_tf.estimate import check, max_by_ns

#: Those that never wait.
PLAIN: Final = (
    "latest_common_time",
    "lookup_transforms",
    "sample",
    "deskew",
    "lookup_velocity",
    "frames",
    "frame",
    "parent",
    "chain",
    "explain",
)

#: Those that have a time-out. A mirror that may block its caller has them as attributes as well.
WAITING: Final = ("lookup_transform", "lookup_transform_full", "can_transform")

#: Those that may ask the server instead.
LATEST: Final = (
    "lookup_latest_transform",
    "lookup_latest_transform_xact",
    "lookup_latest_transforms_xact",
)


#: What estimates call. Now is by the server's clock, so a mirror has methods of its own.
ESTIMATES: Final = ("_estimate_record", "estimate_transforms")


class MirrorReads(ABC):
    """A base of `MirrorCopy`, which has the tree."""

    @property
    @abstractmethod
    def _tree(self) -> TransformTree:
        """The tree. Raises ServerUnavailable if the mirror is closed."""

    @abstractmethod
    def _server_now_ns(self) -> int:
        """The time by the server's real-time clock, as far as it is known here."""

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""
        return self._tree.latest_common_time(a, b)

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.integer[Any]] | None,
    ) -> TransformArray:
        """As `TransformTree.lookup_transforms`."""
        return self._tree.lookup_transforms(targets, sources, stamps_ns)

    def sample(
        self, target: str, source: str, stamps_ns: Sequence[int] | NDArray[np.integer[Any]]
    ) -> TransformArray:
        """As `TransformTree.sample`."""
        return self._tree.sample(target, source, stamps_ns)

    def deskew(
        self,
        points: ArrayLike,
        stamps_ns: ArrayLike,
        source: str,
        fixed_frame: str,
        at_ns: int,
        *,
        out: NDArray[Any] | None = None,
    ) -> NDArray[Any]:
        """As `TransformTree.deskew`."""
        return self._tree.deskew(points, stamps_ns, source, fixed_frame, at_ns, out=out)

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: Sequence[float] | NDArray[np.float64] = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
    ) -> Velocity:
        """As `TransformTree.lookup_velocity`."""
        return self._tree.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
        )

    def estimate_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        max_error_m: float | None = None,
        max_error_rad: float | None = None,
        min_level: float | None = None,
        radius_m: float = 0.0,
    ) -> Estimate:
        """As `TransformTree.estimate_transform`, of the copy; now is by the server's clock."""
        record = self._tree._estimate_record(
            target, source, stamp_ns, self._server_now_ns(), level, max_by_ns(max_by_s), radius_m
        )
        least = level if min_level is None else min_level
        return check(Estimate.from_record(record), max_error_m, max_error_rad, least)

    def estimate_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        radius_m: float = 0.0,
    ) -> EstimateArray:
        """As `TransformTree.estimate_transforms`, of the copy; now is by the server's clock."""
        times = self._server_now_ns() if stamps_ns is None else stamps_ns
        return self._tree.estimate_transforms(
            targets, sources, times, level=level, max_by_s=max_by_s, radius_m=radius_m
        )

    def frames(self) -> list[str]:
        """As `TransformTree.frames`, in any order."""
        return self._tree.frames()

    def frame(self, name: str) -> FrameInfo:
        """As `TransformTree.frame`, without the frame's last change."""
        return self._tree.frame(name)

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """As `TransformTree.parent`."""
        return self._tree.parent(frame, stamp_ns)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """As `TransformTree.chain`."""
        return self._tree.chain(target, source, stamp_ns)

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `TransformTree.explain`."""
        return self._tree.explain(target, source, stamp_ns)
