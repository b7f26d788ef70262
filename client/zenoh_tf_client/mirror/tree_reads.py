"""The lookups of mirrors that are those of their tree."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import TransformTree
from zenoh_tf.array import TransformArray
from zenoh_tf.introspection.explanation import Explanation
from zenoh_tf.introspection.frame_info import FrameInfo
from zenoh_tf.velocity import Velocity


class TreeReads(ABC):
    """A base of `MirrorReads`."""

    @property
    @abstractmethod
    def _tree(self) -> TransformTree:
        """The tree. Raises ServerUnavailable if the mirror is closed."""

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""
        return self._tree.latest_common_time(a, b)

    def frames(self) -> list[str]:
        """As `TransformTree.frames`, in any order."""
        return self._tree.frames()

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """As `TransformTree.parent`."""
        return self._tree.parent(frame, stamp_ns)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """As `TransformTree.chain`."""
        return self._tree.chain(target, source, stamp_ns)

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.integer[Any]] | None,
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """As `TransformTree.lookup_transforms`."""
        return self._tree.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s)

    def sample(
        self,
        target: str,
        source: str,
        stamps_ns: Sequence[int] | NDArray[np.integer[Any]],
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """As `TransformTree.sample`."""
        return self._tree.sample(target, source, stamps_ns, max_gap_s=max_gap_s)

    def deskew(
        self,
        points: ArrayLike,
        stamps_ns: ArrayLike,
        source: str,
        fixed_frame: str,
        at_ns: int,
        *,
        out: NDArray[Any] | None = None,
        begin_ns: int | None = None,
        max_gap_s: float | None = None,
        missing: Literal["nan", "raw"] = "nan",
        ok: NDArray[np.bool_] | None = None,
        strict: bool = False,
    ) -> NDArray[Any]:
        """As `TransformTree.deskew`."""
        return self._tree.deskew(
            points,
            stamps_ns,
            source,
            fixed_frame,
            at_ns,
            out=out,
            begin_ns=begin_ns,
            max_gap_s=max_gap_s,
            missing=missing,
            ok=ok,
            strict=strict,
        )

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
        max_gap_s: float | None = None,
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
            max_gap_s=max_gap_s,
        )

    def frame(self, name: str) -> FrameInfo:
        """As `TransformTree.frame`, without the frame's last change."""
        return self._tree.frame(name)

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """As `TransformTree.explain`."""
        return self._tree.explain(target, source, stamp_ns)
