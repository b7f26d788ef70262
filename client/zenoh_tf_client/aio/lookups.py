"""The lookups of `AsyncTransformClient`."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from zenoh_tf import (
    LatestTransform,
    StampedTransform,
    TransformArray,
    Velocity,
)
from zenoh_tf.shared_tree import AskServer, SharedTree

from ..requests import lookups
from .session.shared_reads import SharedReads


class AsyncLookups:
    """A base of `AsyncTransformClient`, which says how to read.

    Each method reads the server's memory where it is mapped. Else, or if that has no answer, it
    asks the server.
    """

    _reads: SharedReads
    #: The server's memory. Lookups there take so little time that every step before them counts.
    _tree: SharedTree

    async def lookup_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> StampedTransform:
        """Look up the pose of `source` in `target` at a time, interpolated.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            ``X_target_source``: it maps coordinates in `source` to coordinates in `target`, in
            metres. Its ``stamp_ns`` is the time that was used.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name, stamp or time-out is invalid.
            ServiceException: As for every call; see the class.

        Example:
            ``X_map_base = (await tf.lookup_transform("map", "base")).transform``
        """
        found = self._tree.lookup_transform(target, source, stamp_ns, timeout_s)
        if found:
            return found
        return await self._reads.ask(
            found, lookups.lookup_transform(target, source, stamp_ns, timeout_s)
        )

    async def lookup_transform_full(
        self,
        target: str,
        target_stamp_ns: int | None,
        source: str,
        source_stamp_ns: int | None,
        fixed_frame: str,
        timeout_s: float = 0.0,
    ) -> StampedTransform:
        """Look up the pose of `source` at one time in `target` at another time.

        Args:
            target: The frame to express the pose in.
            target_stamp_ns: The time of `target` in nanoseconds; None for the latest common time
                of `target` and `fixed_frame`.
            source: The frame whose pose is asked for.
            source_stamp_ns: The time of `source` in nanoseconds; None for the latest common time
                of `source` and `fixed_frame`.
            fixed_frame: The frame that is assumed not to move between the two times.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            ``X_target_source`` from `source` at `source_stamp_ns` to `target` at
            `target_stamp_ns`, in metres, stamped `target_stamp_ns`.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name, stamp or time-out is invalid.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.lookup_transform_full(
            target, target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s
        )
        if found:
            return found
        request = lookups.lookup_transform_full(
            target, target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s
        )
        return await self._reads.ask(found, request)

    async def can_transform(
        self, target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
    ) -> bool:
        """Return whether `lookup_transform` with the same arguments would succeed.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamp_ns: The time in nanoseconds; None for the latest common time of all links
                between the two frames.
            timeout_s: How long the server may wait for writes that make the lookup possible, in
                seconds from 0 to 3600.

        Returns:
            True if the lookup would succeed, False if it would raise an error of the tree.

        Raises:
            InvalidArgumentException: `stamp_ns` or `timeout_s` is invalid.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.can_transform(target, source, stamp_ns, timeout_s)
        if type(found) is not AskServer:
            return found
        return await self._reads.ask(
            found, lookups.can_transform(target, source, stamp_ns, timeout_s)
        )

    async def lookup_latest_transform(self, target: str, source: str) -> LatestTransform:
        """Look up the pose of `source` in `target` from the newest sample of each link.

        The links are read one after another, so they may come from different commits.
        `lookup_latest_transform_xact` reads one snapshot.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            ``X_target_source``, the oldest stamp among the samples used (``stamp_ns``) and the
            newest one (``newest_stamp_ns``).

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.lookup_latest_transform(target, source)
        if found:
            return found
        return await self._reads.ask(found, lookups.lookup_latest_transform(target, source))

    async def lookup_latest_transform_xact(self, target: str, source: str) -> LatestTransform:
        """Look up the pose of `source` in `target` from the newest samples, in one atomic snapshot.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.

        Returns:
            ``X_target_source``, the oldest stamp among the samples used (``stamp_ns``) and the
            newest one (``newest_stamp_ns``).

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.

        Example:
            ``X_map_wrist = (await tf.lookup_latest_transform_xact("map", "wrist")).transform``
        """
        found = self._tree.lookup_latest_transform_xact(target, source)
        if found:
            return found
        return await self._reads.ask(found, lookups.lookup_latest_transform_xact(target, source))

    async def lookup_latest_transforms_xact(
        self, pairs: Sequence[tuple[str, str]]
    ) -> list[LatestTransform]:
        """Look up several latest poses in one atomic snapshot.

        Args:
            pairs: (target, source) frames of each pose.

        Returns:
            For each pair what `lookup_latest_transform_xact` returns, in order.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.

        Example:
            ``arm, cup = await tf.lookup_latest_transforms_xact([("map", "arm"), ("map", "cup")])``
        """
        found = self._tree.lookup_latest_transforms_xact(pairs)
        if type(found) is not AskServer:
            return found
        return await self._reads.ask(found, lookups.lookup_latest_transforms_xact(pairs))

    async def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
    ) -> TransformArray:
        """Look up many poses in one request, each in a transaction of its own.

        Args:
            targets: (n,) frames to express the poses in, or one frame for all rows.
            sources: (n,) frames whose poses are asked for, or one frame for all rows.
            stamps_ns: (n,) times in nanoseconds, or one for all rows; None for the latest common
                times.

        Returns:
            (n,) rows. Row i is ``X_target_source`` of lookup i, in metres. A row that failed has
            its error's code in ``status``.

        Raises:
            InvalidArgumentException: The lengths differ, or a stamp is not a 64-bit integer.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.lookup_transforms(targets, sources, stamps_ns)
        if type(found) is not AskServer:
            return found
        return await self._reads.ask(found, lookups.lookup_transforms(targets, sources, stamps_ns))

    async def sample(self, target: str, source: str, stamps_ns: ArrayLike) -> TransformArray:
        """Look up the pose of `source` in `target` at many times in one request.

        Args:
            target: The frame to express the pose in.
            source: The frame whose pose is asked for.
            stamps_ns: (n,) times in nanoseconds; sorted times are fastest.

        Returns:
            (n,) rows. Row i is ``X_target_source`` at ``stamps_ns[i]``, in metres. A row that
            failed has its error's code in ``status``.

        Raises:
            InvalidArgumentException: A stamp is not a 64-bit integer.
            ServiceException: As for every call; see the class.

        Example:
            ``path = (await tf.sample("map", "camera", stamps_ns)).translations``
        """
        return await self.lookup_transforms(target, source, stamps_ns)

    async def latest_common_time(self, a: str, b: str) -> int | None:
        """Return the newest time that every link between two frames can serve.

        Args:
            a: One frame.
            b: The other frame.

        Returns:
            The time in nanoseconds; None if all links between the frames are static.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: A name is empty or not valid UTF-8.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.latest_common_time(a, b)
        if type(found) is not AskServer:
            return found
        return await self._reads.ask(found, lookups.latest_common_time(a, b))

    async def lookup_velocity(
        self,
        tracking_frame: str,
        observation_frame: str,
        stamp_ns: int | None = None,
        averaging_interval_s: float = 0.1,
        *,
        reference_frame: str | None = None,
        reference_point: ArrayLike = (0.0, 0.0, 0.0),
        reference_point_frame: str | None = None,
    ) -> Velocity:
        """Look up how fast `tracking_frame` moves as seen from `observation_frame`.

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
            The mean linear velocity in m/s and the mean angular velocity in rad/s, (3,) each.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for the time.
            InvalidArgumentException: An argument is invalid.
            ServiceException: As for every call; see the class.
        """
        found = self._tree.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
        )
        if type(found) is not AskServer:
            return found
        request = lookups.lookup_velocity(
            tracking_frame,
            observation_frame,
            stamp_ns,
            averaging_interval_s,
            reference_frame=reference_frame,
            reference_point=reference_point,
            reference_point_frame=reference_point_frame,
        )
        return await self._reads.ask(found, request)
