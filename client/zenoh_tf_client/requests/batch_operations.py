"""The operations that a `Batch` records, one method for each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from numpy.typing import ArrayLike

from zenoh_tf import (
    Estimate,
    EstimateArray,
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
)

from . import estimates, info, lookups, writes
from .handle import Handle
from .request import Request

if TYPE_CHECKING:
    from zenoh_tf import AuthorityInfo, FrameInfo

T = TypeVar("T")


class BatchOperations(ABC):
    """The base of both batches. Each method records that of `TransformClient` with its name.

    It checks the arguments at once. The handle's `result()` returns what that method returns, and
    raises what it raises.
    """

    @abstractmethod
    def _record(self, request: Request[T]) -> Handle[T]:
        """Add a request to what the batch sends."""

    def sample(
        self, target: str, source: str, stamps_ns: ArrayLike, *, max_gap_s: float | None = None
    ) -> Handle[TransformArray]:
        """As `TransformTree.sample`."""
        return self.lookup_transforms(target, source, stamps_ns, max_gap_s=max_gap_s)

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp_ns: int | None = None,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> Handle[StampedTransform]:
        """As `TransformClient.lookup_transform`."""
        return self._record(
            lookups.lookup_transform(target, source, stamp_ns, timeout_s, max_gap_s=max_gap_s)
        )

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
        *,
        max_gap_s: float | None = None,
    ) -> Handle[StampedTransform]:
        """As `TransformClient.lookup_transform_full`."""
        return self._record(
            lookups.lookup_transform_full(
                target,
                target_stamp_ns,
                source,
                source_stamp_ns,
                fixed_frame,
                timeout_s,
                max_gap_s=max_gap_s,
            )
        )

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> Handle[bool]:
        """As `TransformClient.can_transform`."""
        return self._record(lookups.can_transform(target, source, stamp_ns, timeout_s))

    def lookup_latest_transform(self, target: str, source: str) -> Handle[LatestTransform]:
        """As `TransformClient.lookup_latest_transform`."""
        return self._record(lookups.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(self, target: str, source: str) -> Handle[LatestTransform]:
        """As `TransformClient.lookup_latest_transform_xact`."""
        return self._record(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> Handle[list[LatestTransform]]:
        """As `TransformClient.lookup_latest_transforms_xact`."""
        return self._record(lookups.lookup_latest_transforms_xact(pairs))

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        max_gap_s: float | None = None,
    ) -> Handle[TransformArray]:
        """As `TransformClient.lookup_transforms`."""
        return self._record(
            lookups.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s)
        )

    def latest_common_time(self, a: str, b: str) -> Handle[int | None]:
        """As `TransformClient.latest_common_time`."""
        return self._record(lookups.latest_common_time(a, b))

    def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: ArrayLike = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
        max_gap_s: float | None = None,
    ) -> Handle[Velocity]:
        """As `TransformClient.lookup_velocity`."""
        return self._record(
            lookups.lookup_velocity(
                tracking_frame,
                observation_frame,
                stamp_ns,
                averaging_interval_s,
                reference_frame=reference_frame,
                reference_point=reference_point,
                reference_point_frame=reference_point_frame,
                max_gap_s=max_gap_s,
            )
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
    ) -> Handle[Estimate]:
        """As `TransformClient.estimate_transform`."""
        return self._record(
            estimates.estimate_transform(
                target,
                source,
                stamp_ns,
                level=level,
                max_by_s=max_by_s,
                max_error_m=max_error_m,
                max_error_rad=max_error_rad,
                min_level=min_level,
                radius_m=radius_m,
            )
        )

    def estimate_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        level: float = 0.9,
        max_by_s: float = 0.5,
        radius_m: float = 0.0,
    ) -> Handle[EstimateArray]:
        """As `TransformClient.estimate_transforms`."""
        return self._record(
            estimates.estimate_transforms(
                targets, sources, stamps_ns, level=level, max_by_s=max_by_s, radius_m=radius_m
            )
        )

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> Handle[bool]:
        """As `TransformClient.set_transform`."""
        return self._record(writes.set_transform(stamped, authority, static))

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> Handle[None]:
        """As `TransformClient.set_transforms_xact`."""
        return self._record(writes.set_transforms_xact(stampeds, authority, static))

    def frames(self) -> Handle[list[str]]:
        """As `TransformClient.frames`."""
        return self._record(info.frames())

    def frame(self, name: str) -> Handle[FrameInfo]:
        """As `TransformClient.frame`."""
        return self._record(info.frame(name))

    def authorities(self) -> Handle[list[AuthorityInfo]]:
        """As `TransformClient.authorities`."""
        return self._record(info.authorities())

    def parent(self, frame: str, stamp_ns: int | None = None) -> Handle[str | None]:
        """As `TransformClient.parent`."""
        return self._record(info.parent(frame, stamp_ns))

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> Handle[list[str]]:
        """As `TransformClient.chain`."""
        return self._record(info.chain(target, source, stamp_ns))

    def stats(self) -> Handle[dict[str, int]]:
        """As `TransformClient.stats`."""
        return self._record(info.stats())
