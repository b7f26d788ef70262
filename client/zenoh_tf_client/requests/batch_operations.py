"""The operations that a `Batch` records, one method for each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TypeVar

from numpy.typing import ArrayLike

from zenoh_tf import (
    AuthorityInfo,
    FrameInfo,
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
)

from . import info, lookups, writes
from .handle import Handle
from .request import Request

T = TypeVar("T")


class BatchOperations(ABC):
    """The base of `Batch`. Each method has the arguments of `TransformClient`'s of the same name.

    The handle's `result()` returns what that method returns, and raises what it raises.
    """

    @abstractmethod
    def _record(self, request: Request[T]) -> Handle[T]:
        """Add a request to what the batch sends."""

    def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> Handle[StampedTransform]:
        """Record a `TransformClient.lookup_transform`.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            A handle of the result. ``X_target_source``: it maps coordinates in `source` to
            coordinates in `target`, in metres. Its ``stamp_ns`` is the time that was used.

        Raises:
            InvalidArgumentException: `stamp_ns` is not a 64-bit integer.
        """
        return self._record(lookups.lookup_transform(target, source, stamp_ns, timeout_s))

    def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> Handle[StampedTransform]:
        """Record a `TransformClient.lookup_transform_full`.

        Args:
            target: The frame to express the pose in.
            target_stamp_ns: The time of `target` in nanoseconds; None for the latest common time
                of `target` and `fixed_frame`.
            source: The frame whose pose is asked for.
            source_stamp_ns: The time of `source` in nanoseconds; None for the latest common time
                of `source` and `fixed_frame`.
            fixed_frame: The frame that is taken not to move between the two times.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            A handle of the result. ``X_target_source`` from `source` at `source_stamp_ns` to
            `target` at `target_stamp_ns`, in metres, stamped `target_stamp_ns`.

        Raises:
            InvalidArgumentException: A stamp is not a 64-bit integer, or `timeout_s` is out of
                range.
        """
        return self._record(
            lookups.lookup_transform_full(
                target, target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s
            )
        )

    def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> Handle[bool]:
        """Record a `TransformClient.can_transform`.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            A handle of the result. True if the lookup would succeed, False if it would raise an
            error of the tree.

        Raises:
            InvalidArgumentException: `stamp_ns` is not a 64-bit integer.
        """
        return self._record(lookups.can_transform(target, source, stamp_ns, timeout_s))

    def lookup_latest_transform(self, target: str, source: str) -> Handle[LatestTransform]:
        """Record a `TransformClient.lookup_latest_transform`.

        The links are read one after another, so they may come from different commits.
        `lookup_latest_transform_xact` reads one snapshot.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            A handle of the result. ``X_target_source``, the oldest stamp among the samples used
            (``stamp_ns``) and the newest one (``newest_stamp_ns``).
        """
        return self._record(lookups.lookup_latest_transform(target, source))

    def lookup_latest_transform_xact(self, target: str, source: str) -> Handle[LatestTransform]:
        """Record a `TransformClient.lookup_latest_transform_xact`.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            A handle of the result. ``X_target_source``, the oldest stamp among the samples used
            (``stamp_ns``) and the newest one (``newest_stamp_ns``).
        """
        return self._record(lookups.lookup_latest_transform_xact(target, source))

    def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> Handle[list[LatestTransform]]:
        """Record a `TransformClient.lookup_latest_transforms_xact`.

        Args:
            pairs: (target, source) frames of each pose.

        Returns:
            A handle of the result. For each pair what `lookup_latest_transform_xact` returns, in
            order.
        """
        return self._record(lookups.lookup_latest_transforms_xact(pairs))

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
    ) -> Handle[TransformArray]:
        """Record a `TransformClient.lookup_transforms`.

        Args:
            targets: (n,) frames to express the poses in, or one frame for all rows.
            sources: (n,) frames whose poses are asked for, or one frame for all rows.
            stamps_ns: (n,) times in nanoseconds, or one for all rows; None for the latest common
                times.

        Returns:
            A handle of the result. (n,) rows. Row i is ``X_target_source`` of lookup i, in
            metres. A row that failed has its error's code in ``status``.

        Raises:
            InvalidArgumentException: The lengths differ, or a stamp is not a 64-bit integer.
        """
        return self._record(lookups.lookup_transforms(targets, sources, stamps_ns))

    def sample(self, target: str, source: str, stamps_ns: ArrayLike) -> Handle[TransformArray]:
        """Record a `TransformClient.sample`.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamps_ns: (n,) times in nanoseconds; sorted times are fastest.

        Returns:
            A handle of the result. (n,) rows. Row i is ``X_target_source`` at ``stamps_ns[i]``,
            in metres. A row that failed has its error's code in ``status``.

        Raises:
            InvalidArgumentException: A stamp is not a 64-bit integer.
        """
        return self._record(lookups.sample(target, source, stamps_ns))

    def latest_common_time(self, a: str, b: str) -> Handle[int | None]:
        """Record a `TransformClient.latest_common_time`.

        Args:
            a: One frame.
            b: The other frame.

        Returns:
            A handle of the result. The time in nanoseconds; None if all links between the frames
            are static.
        """
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
    ) -> Handle[Velocity]:
        """Record a `TransformClient.lookup_velocity`.

        Args:
            tracking_frame: The frame that moves.
            observation_frame: The frame that counts as standing still.
            stamp_ns: The middle of the averaging interval in nanoseconds; None for the latest
                common time of the two frames.
            averaging_interval_s: The length of the interval, from 1e-9 to 1e9 seconds.
            reference_frame: The frame whose axes the velocity is expressed in; None for
                `observation_frame`.
            reference_point: (3,) metres: the point of the moving body whose linear velocity is
                asked for.
            reference_point_frame: The frame that `reference_point` is expressed in; None for
                `tracking_frame`.

        Returns:
            A handle of the result. The mean linear velocity in m/s and the mean angular velocity
            in rad/s, (3,) each.

        Raises:
            InvalidArgumentException: An argument makes no sense.
        """
        return self._record(
            lookups.lookup_velocity(
                tracking_frame,
                observation_frame,
                stamp_ns,
                averaging_interval_s,
                reference_frame=reference_frame,
                reference_point=reference_point,
                reference_point_frame=reference_point_frame,
            )
        )

    def set_transform(
        self, stamped: StampedTransform, authority: str = "", static: bool = False
    ) -> Handle[bool]:
        """Record a `TransformClient.set_transform`: store a transform.

        Args:
            stamped: ``X_parent_child``: it maps coordinates in the child frame to coordinates in
                the parent frame. Metres; nanoseconds.
            authority: The name to publish as.
            static: True for a transform that holds at all times.

        Returns:
            A handle of the result. True if stored, False if dropped because it is older than
            the server's cache time.
        """
        return self._record(writes.set_transform(stamped, authority, static))

    def set_transforms_xact(
        self, stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
    ) -> Handle[None]:
        """Record a `TransformClient.set_transforms_xact`: store transforms atomically.

        Args:
            stampeds: Transforms, each ``X_parent_child`` as in `set_transform`.
            authority: The name to publish as.
            static: True for transforms that hold at all times.

        Returns:
            A handle of the result, which is None.
        """
        return self._record(writes.set_transforms_xact(stampeds, authority, static))

    # --- introspection

    def frames(self) -> Handle[list[str]]:
        """Record a `TransformClient.frames`: list the names of all frames.

        Returns:
            A handle of the result. The names, in no particular order.
        """
        return self._record(info.frames())

    def frame(self, name: str) -> Handle[FrameInfo]:
        """Record a `TransformClient.frame`: describe a frame and the link to its parent.

        Args:
            name: The frame.

        Returns:
            A handle of the result. The parent, authority, stamps in nanoseconds and counters,
            read at one instant.
        """
        return self._record(info.frame(name))

    def authorities(self) -> Handle[list[AuthorityInfo]]:
        """Record a `TransformClient.authorities`: list what each authority has published.

        Returns:
            A handle of the result. One record for each authority, in the order of their first
            commits.
        """
        return self._record(info.authorities())

    def parent(self, frame: str, stamp_ns: int | None = None) -> Handle[str | None]:
        """Record a `TransformClient.parent`: return the parent of a frame.

        Args:
            frame: The frame.
            stamp_ns: The time in nanoseconds; None for the newest parent.

        Returns:
            A handle of the result. The parent's name; None if the frame is a root.
        """
        return self._record(info.parent(frame, stamp_ns))

    def chain(self, target: str, source: str, stamp_ns: int | None = None) -> Handle[list[str]]:
        """Record a `TransformClient.chain`.

        Args:
            target: The frame where the path begins.
            source: The frame where the path ends.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.

        Returns:
            A handle of the result. The frames in order, from `target` to `source`, both included.
        """
        return self._record(info.chain(target, source, stamp_ns))

    def stats(self) -> Handle[dict[str, int]]:
        """Record a `TransformClient.stats`: return the counters of the tree and of the server.

        Returns:
            A handle of the result. Values by the counters' names.
        """
        return self._record(info.stats())
