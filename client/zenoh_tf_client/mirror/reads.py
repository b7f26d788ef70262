"""The lookups of mirrors that never wait: those of the embedded tree.

While there is a copy, the methods here are not called: the mirror has the tree's own methods as
attributes, because a call of Python's in between would cost half as much as a lookup.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import (
    Estimate,
    Explanation,
    FrameInfo,
    TransformArray,
    TransformTree,
    Velocity,
)
from zenoh_tf.estimate import TreeEstimates
from zenoh_tf.text.times import age

if TYPE_CHECKING:
    from zenoh_tf._core_stubs.estimates import EstimateColumns

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
    "_estimate",
    "_estimate_columns",
)

#: Those that have a time-out. A mirror that may block its caller has them as attributes as well.
WAITING: Final = ("lookup_transform", "lookup_transform_full", "can_transform")

#: Those that may ask the server instead.
LATEST: Final = (
    "lookup_latest_transform",
    "lookup_latest_transform_xact",
    "lookup_latest_transforms_xact",
)


class MirrorReads(ABC):
    """A base of `BaseMirror`, which has the tree."""

    #: A mirror that is older does not hear its server.
    _silent_s: float

    @abstractmethod
    def _now_ns(self) -> int:
        """The time by the server's real-time clock, as far as it is known here."""

    @property
    @abstractmethod
    def age_s(self) -> float:
        """How old what is read may be, in seconds."""

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
        """As `TransformTree.explain`, also if the mirror does not hear its server."""
        found, age_s = self._tree.explain(target, source, stamp_ns), self.age_s
        if age_s < self._silent_s:
            return found
        return replace(
            found,
            reasons=(
                *found.reasons,
                f"The mirror is disconnected from its server for {age(round(age_s * 1e9))}, and "
                "its last poses are read.",
            ),
            advice=(*found.advice, "Check that the server runs, and the network to it."),
        )

    estimate_transform = TreeEstimates.estimate_transform
    estimate_transforms = TreeEstimates.estimate_transforms

    def _estimate(self, *arguments: Any) -> Estimate:
        return self._tree._estimate(*arguments)

    def _estimate_columns(self, *arguments: Any) -> EstimateColumns:
        return self._tree._estimate_columns(*arguments)
