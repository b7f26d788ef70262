"""Reads of `TransformClient` that need nothing of their own."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/reads.py: edit that.

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

from numpy.typing import ArrayLike

from zenoh_tf import Estimate, EstimateArray, FrameInfo, TransformArray, Velocity
from zenoh_tf.shared_tree import AskServer, SharedTree

from .requests import estimates, info, lookups
from .requests.request import Request
from .session.connection import Connection

P = ParamSpec("P")
T = TypeVar("T")


class Reads:
    """A base of `TransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _connection: Connection
    #: The server's memory. Lookups there take so little time that every step before them counts.
    _tree: SharedTree

    def _look_up(
        self,
        look_up: Callable[..., T | AskServer],
        make: Callable[P, Request[T]],
        *args: P.args,
        **kwargs: P.kwargs,
    ) -> T:
        found = look_up(*args, **kwargs)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(make(*args, **kwargs), found)

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        """As `TransformTree.can_transform`; the server waits, up to 3600 s."""
        found = self._tree.can_transform(target, source, stamp_ns, timeout_s)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(
            lookups.can_transform(target, source, stamp_ns, timeout_s), found
        )

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """As `TransformTree.lookup_transforms`, in one request."""
        found = self._tree.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(
            lookups.lookup_transforms(targets, sources, stamps_ns, max_gap_s=max_gap_s), found
        )

    def latest_common_time(self, a: str, b: str) -> int | None:
        """As `TransformTree.latest_common_time`."""
        found = self._tree.latest_common_time(a, b)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(lookups.latest_common_time(a, b), found)

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
    ) -> Velocity:
        """As `TransformTree.lookup_velocity`."""
        return self._look_up(
            self._tree.lookup_velocity,
            lookups.lookup_velocity,
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
            max_gap_s=max_gap_s,
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
        """As `TransformTree.estimate_transform`; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``found = tf.estimate_transform("map", "base", max_error_m=0.02)``
        """
        return self._look_up(
            self._tree.estimate_transform,
            estimates.estimate_transform,
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
        """As `TransformTree.estimate_transforms`, in one request; now is by the server's clock.

        Raises:
            ServiceException: As for every call; see the class.

        Example:
            ``found = tf.estimate_transforms("map", arms, None)``
        """
        return self._look_up(
            self._tree.estimate_transforms,
            estimates.estimate_transforms,
            targets,
            sources,
            stamps_ns,
            level=level,
            max_by_s=max_by_s,
            radius_m=radius_m,
        )

    def frame(self, name: str) -> FrameInfo:
        """As `TransformTree.frame`."""
        return self._look_up(self._tree.frame, info.frame, name)

    def parent(self, frame: str, stamp_ns: int | None = None) -> str | None:
        """As `TransformTree.parent`."""
        found = self._tree.parent(frame, stamp_ns)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(info.parent(frame, stamp_ns), found)

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> list[str]:
        """As `TransformTree.chain`."""
        found = self._tree.chain(target, source, stamp_ns)
        if not isinstance(found, AskServer):
            return found
        return self._connection.call(info.chain(target, source, stamp_ns), found)
