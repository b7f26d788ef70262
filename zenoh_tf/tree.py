"""The embedded tree: transforms of the last seconds, in this process."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zenoh_tf import _core
from zenoh_tf.array import TransformArray
from zenoh_tf.frame_info import AuthorityInfo, FrameInfo
from zenoh_tf.velocity import Velocity, interval_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray


class TransformTree(_core.Tree):
    """A tree of frames with the history of every link.

    ``X_target_source`` below is the pose of source in target: it maps coordinates in source to
    coordinates in target. Stamps are integer nanoseconds. Any thread may call anything.

    Args:
        cache_time_s: How long samples are kept, counted back from the newest of their link.
        concurrency: ``"optimistic"`` (readers validate and share nothing), ``"2pl"`` (two-phase
            locking) or ``"giant"`` (one mutex around the tree, as tf2).
        max_frames, max_samples_per_frame, max_name_bytes, max_depth: Limits; ``LimitExceeded``
            names the one that was hit. A link that is full drops its oldest sample and counts it.
            ``max_depth`` is the number of links that a lookup climbs from either frame.
        one_authority_per_frame: Refuse a write to a link that another authority has written.
        time_jump: What a transform means that is older than its link's newest by more than the
            cache time. ``"reject"``: it is late, and dropped or refused. ``"clear"``: time was set
            back, as simulators do; everything but static links is dropped, and it is stored.
            A jump back by less than the cache time cannot be told from a late transform.

    Writing (``InvalidArgumentException`` says what is wrong, for which frames):
        ``set_transform(stamped, authority="", static=False)``: True stored, False dropped because
        older than newest - cache time. ``set_transforms_xact(stampeds, ...)``: all or nothing, at
        one instant; one that is too old refuses the whole. At an equal stamp the last one wins. A
        set that would close a cycle is refused.

    Reading:
        ``lookup_transform(target, source, stamp_ns=None, timeout_s=0.0)``: at that time, or at
        the latest common time of all links between the two. ``lookup_transform_full(target,
        target_stamp_ns, source, source_stamp_ns, fixed_frame, timeout_s=0.0)``: source at one
        time in target at another, through a frame that is fixed in between.
        ``can_transform(...)`` never raises for a missing transform.
        ``lookup_latest_transform(target, source)``: the newest of every link, each by itself;
        ``lookup_latest_transform_xact``: the same at one instant;
        ``lookup_latest_transforms_xact(pairs)``: several at one instant.
        ``timeout_s``: how long to wait for a write that makes the answer possible.

    Errors: ``LookupException``, ``ConnectivityException``, ``ExtrapolationException``,
    ``InvalidArgumentException``, ``LimitExceeded`` with their facts (``zenoh_tf.errors``).
    """

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.int64] | None,
    ) -> TransformArray:
        """Many lookups in one call, each a transaction of its own.

        A single name or stamp stands for every row, ``None`` for the latest common time. The
        interpreter lock is released meanwhile. Errors are in ``status``, in place.
        """
        return TransformArray(*self.lookup_columns(targets, sources, stamps_ns))

    def sample(
        self, target: str, source: str, stamps_ns: Sequence[int] | NDArray[np.int64]
    ) -> TransformArray:
        """One pair of frames at many times; see ``lookup_transforms``, which gives the same.

        Fastest where the times are sorted: every link's samples are then walked along, not
        searched again for each time.
        """
        return self.lookup_transforms(target, source, stamps_ns)

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
        """How the tracking frame moves in the observation frame; ``Velocity`` says what that is.

        Everything is read at one instant. The errors are those of the lookups that it takes, each
        naming its two frames: of the tracking frame at both ends of the window and at the time
        itself, and of the two reference frames at the time.

        Args:
            tracking_frame: The frame whose motion is asked for.
            observation_frame: The frame that counts as standing still.
            stamp_ns: The middle of the window; ``None``: the latest common time of the two.
            averaging_interval_s: The length of the window, from 1e-9 to 1e9 seconds.
            reference_frame: In whose axes the answer is; ``None``: the observation frame's.
            reference_point: (3,) metres; the body's point there has the linear velocity.
            reference_point_frame: Where the reference point is given; ``None``: in the tracking
                frame, so that the default is the velocity of its origin.
        """
        return Velocity.from_record(
            self.velocity_record(
                tracking_frame,
                observation_frame,
                stamp_ns,
                interval_ns(averaging_interval_s),
                reference_frame,
                reference_point,
                reference_point_frame,
            )
        )

    def frame(self, name: str) -> FrameInfo:
        """What is known about a frame and its link; ``LookupException`` if it does not exist."""
        return FrameInfo.from_record(self.frame_record(name))

    def authorities(self) -> list[AuthorityInfo]:
        """What each authority has done, in the order of their first commits."""
        return [AuthorityInfo(**record) for record in self.authority_records()]
