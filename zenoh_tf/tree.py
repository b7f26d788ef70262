"""The embedded tree: transforms of the last seconds, in this process."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, Literal

from zenoh_tf import _core
from zenoh_tf.array import TransformArray
from zenoh_tf.clouds.points import Sweep, SweepOptions, deskew
from zenoh_tf.errors import LookupException, ServerStarting
from zenoh_tf.estimate import TreeEstimates
from zenoh_tf.gap_limit import max_gap_ns
from zenoh_tf.velocity import Velocity, interval_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from os import PathLike

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from zenoh_tf.gates.gate import Gate, GateLookups
    from zenoh_tf.gates.queue import Dropped
    from zenoh_tf.introspection.explanation import Explanation
    from zenoh_tf.introspection.frame_info import AuthorityInfo, FrameInfo


class TransformTree(TreeEstimates):
    """A tree of frames with the history of every link. Any thread may call any method.

    `X_target_source` is the pose of source in target: it maps coordinates in source to coordinates
    in target. Stamps are integer nanoseconds of any one clock, lengths are metres.

    Example:
        >>> tree = TransformTree()
        >>> tree.set_transform(StampedTransform("map", "base", 0, Transform((1, 0, 0))))
        True
        >>> tree.lookup_transform("map", "base").transform.apply((0, 0, 0))
        array([1., 0., 0.])

    Args:
        cache_time_s: Seconds to keep samples, counted back from the newest of their link.
        concurrency: `"optimistic"` (readers validate and write nothing shared), `"2pl"` (two-phase
            locking) or `"giant"` (one mutex around the tree, as in tf2).
        max_frames: Most frames; more raise `LimitExceeded`.
        max_samples_per_frame: Most samples of one link; a full link evicts its oldest sample and
            counts it.
        max_name_bytes: Most bytes of a frame's name in UTF-8; longer ones raise `LimitExceeded`.
        max_depth: Most links between a frame and its root: a write whose child would be deeper
            raises `LimitExceeded`. Also the most links that a lookup follows upwards from either
            frame, so lookups of frames that a moved parent takes deeper raise `LookupException`.
            0 means no limit; then a change of parent takes as long as there are frames above it.
        one_authority_per_frame: Reject a write to a link that another authority has written.
        time_jump: What a transform means that is older than its link's newest by more than the
            cache time. `"reject"`: it is late, so it is dropped or rejected. `"clear"`: so it is,
            but if a second, newer one follows it within the cache time, with no other one in
            between, time was set back, as simulators do: the link's history is cleared, and the
            second one is stored; back by more than a day it is another clock, and takes 10 of
            them, or 5 s. A jump back by less looks like a late transform. In both cases
            a history that ends ahead of the real-time clock by more than the cache time is
            cleared so, too.
        max_memory_bytes: Most bytes of all samples together; a write that needs more raises
            `LimitExceeded`. 0 means no limit.
        max_log_bytes: Most bytes of the log of changes, which servers stream to mirrors. 0 means no
            log.

    Raises:
        InvalidArgumentException: An option is out of its range.
    """

    @classmethod
    def from_recording(
        cls,
        path: str | PathLike[str],
        *,
        topics: str | Collection[str] | None = None,
        prefixes: Mapping[str, str] | None = None,
        max_memory_bytes: int | None = None,
        until_ns: int | None = None,
    ) -> TransformTree:
        """Make a tree from a recording, with its whole history.

        Reads MCAP (ROS 2, ROS 1, Foxglove), rosbag2 and ROS 1 bags; see docs/how-to/recordings.md.
        Links of topics called `tf_static`, in any namespace, hold at all times. What no tree
        accepts is left out; the logger `zenoh_tf.recordings` reports how much. Needs the libraries
        of `pip install 'zenoh-tf[recordings]'`.

        Args:
            path: The file, or the folder of `ros2 bag record`.
            topics: Names of topics to read, or one name, with or without a slash at the begin; None
                for all that have transforms. Topics with one pose (TransformStamped, PoseStamped,
                PoseWithCovarianceStamped, Odometry) are read only if they are named.
            prefixes: By topic, what comes before the names of its frames, with a slash between
                them: `{"/tf_gt": "truth"}` makes `base` of `/tf_gt` to `truth/base`. That of a
                topic `tf` holds for `tf_static` of its namespace as well.
            max_memory_bytes: Most bytes of all samples together; None for 4 GiB, 0 for no limit.
            until_ns: Leave out what was recorded later, in nanoseconds. The tree then knows what a
                live one knew at that time, which is "now" for `estimate_transform`. None for all.

        Returns:
            A tree that never drops a sample for its age. Stamps are as recorded, in nanoseconds.

        Raises:
            RecordingError: The recording cannot be read, has no transforms, has a link on two
                topics (choose by `topics` or `prefixes`), or a library is missing. With `until_ns`
                also if its times are of another clock than its stamps.
            LimitExceeded: The recording needs more memory; `field` is "max_memory".
            InvalidArgumentException: A name of a topic or a prefix is empty; `field` is "topics" or
                "prefixes".

        Example:
            `TransformTree.from_recording("run.mcap").sample("map", "base", stamps_ns)`
        """
        from zenoh_tf import recordings  # noqa: PLC0415 - it imports what imports this module

        limit = recordings.MAX_MEMORY_BYTES if max_memory_bytes is None else max_memory_bytes
        tree = cls(**recordings.OPTIONS, max_memory_bytes=limit)
        with recordings.open_recording(path, topics, prefixes) as recording:
            recordings.load(recording, tree, until_ns=until_ns)
            for warning in recording.warnings():
                logging.getLogger("zenoh_tf.recordings").warning("%s: %s", path, warning)
        return tree

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: int | Sequence[int] | NDArray[np.integer[Any]] | None,
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """Look up many transforms in one call, without the GIL; each row is its own transaction.

        A row that fails does not raise: its `status` is the error's code and its pose is NaN.
        Example: `tree.lookup_transforms("map", ["a", "b"], None).raise_for_status().translations`

        Args:
            targets: Frames to express coordinates in; one name stands for every row.
            sources: Frames whose coordinates are given; one name stands for every row.
            stamps_ns: Times in nanoseconds; one int stands for every row, and None for the latest
                common time of every row.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.
                Rows beyond it fail as `GapTooLong`.

        Returns:
            `X_target_source` of every row, in metres.

        Raises:
            InvalidArgumentException: A name, a stamp or the limit is invalid, or the numbers of
                rows differ.
        """
        status, stamps, poses, gaps = self._lookup_columns(targets, sources, stamps_ns, max_gap_s)
        return TransformArray._answers(stamps_ns, status, stamps, poses, targets, sources, gaps)

    def sample(
        self,
        target: str,
        source: str,
        stamps_ns: Sequence[int] | NDArray[np.integer[Any]],
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray:
        """Look up one pair of frames at many times; see `lookup_transforms`.

        Sorted times are fastest: each link's samples are then scanned, not searched for each row.
        Example: `tree.sample("map", "lidar", stamps_ns).raise_for_status().apply(points)`

        Args:
            target: Frame to express coordinates in.
            source: Frame whose coordinates are given.
            stamps_ns: (n,) times in nanoseconds.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.
                Rows beyond it fail as `GapTooLong`.

        Returns:
            `X_target_source` at every time, in metres; NaN in rows that failed.

        Raises:
            InvalidArgumentException: A name, a stamp or the limit is invalid.
        """
        return self.lookup_transforms(target, source, stamps_ns, max_gap_s=max_gap_s)

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
        """Return how the tracking frame moves in the observation frame, read at one instant.

        Args:
            tracking_frame: Frame whose motion is measured.
            observation_frame: Frame that counts as standing still.
            stamp_ns: Middle of the averaging window in nanoseconds; None means the latest common
                time of the two frames.
            averaging_interval_s: Length of the window, from 1e-9 to 1e9 seconds.
            reference_frame: Frame in whose axes the answer is; None means the observation frame.
            reference_point: (3,) metres; the linear velocity is of the body's point there.
            reference_point_frame: Frame of the reference point; None means the tracking frame, so
                that the default is the velocity of its origin.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.

        Returns:
            The mean twist over the window, in m/s and rad/s; see `Velocity`. Its `gap_ns` is not 0
            if nothing was measured at a time of the window.

        Raises:
            LookupException: A frame does not exist, or a path is longer than `max_depth`.
            ConnectivityException: No path connects two of the frames.
            ExtrapolationException: A link has no data for a time of the window.
            GapTooLong: The samples of a link around such a time are farther apart than `max_gap_s`.
            InvalidArgumentException: A name, the stamp, the interval, the point or the limit is
                invalid.
        """
        return Velocity.from_record(
            self._velocity_record(
                tracking_frame,
                observation_frame,
                stamp_ns,
                interval_ns(averaging_interval_s),
                reference_frame,
                reference_point,
                reference_point_frame,
                max_gap_ns(max_gap_s),
            )
        )

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
        """Return a sweep's points as if all had been measured at one time.

        A lidar that moves measures each point from elsewhere. This moves every point along with
        the sensor: from `source` at the point's stamp, through the fixed frame, to `source` at
        `at_ns`. All poses are of one state of the tree. A point whose time has no pose becomes NaN:
        its stamp is 0 or otherwise outside of a link's history, or in a gap, in which nothing was
        measured. docs/how-to/sensor-data.md has more.

        Example: `cloud = tree.deskew(points, stamps_ns, "lidar", "odom", int(stamps_ns.max()))`

        Args:
            points: (n, 3) or (rows, columns, 3) metres, in `source` at the time of each point. Any
                strides; float32 and float64 are read where they are. NaN stays NaN.
            stamps_ns: The time of each point in integer nanoseconds: (n,), (rows, columns), or what
                broadcasts to it, such as one stamp for each column.
            source: Frame of the sensor.
            fixed_frame: Frame in which the surroundings stand still, such as `odom`.
            at_ns: Time in nanoseconds to move all points to.
            out: Array of the points' shape to write to, float32 or float64. It may be `points`
                itself, but must not overlap with it otherwise.
            begin_ns: The time in nanoseconds that `stamps_ns` are offsets from; None: they are
                absolute. Offsets may be negative, also as unsigned 32-bit numbers that wrapped. An
                offset of 0 far from all others means a lost column, whose points have no time.
            max_gap_s: Most seconds between two samples of a link to interpolate over. None: any
                but a gap; see `StampedTransform.gap_ns`.
            missing: What becomes of points without a pose: `"nan"`, or `"raw"` to leave them as
                they were measured.
            ok: Bool array, (n,) or (rows, columns), to write to: whether each point was moved.
            strict: Raise the error of the first time without a pose instead.

        Returns:
            `out`, or a new array of the points' shape and type: metres, in `source` at `at_ns`.

        Raises:
            LookupException: A frame does not exist, or the path is longer than `max_depth`.
            ConnectivityException: No path connects the frames.
            ExtrapolationException: A link has no data for `at_ns`, or for the time of any point;
                with `strict`, for that of one. The error has the time and the link's range.
            InvalidArgumentException: An argument is invalid, or the arrays do not fit.
        """
        options = SweepOptions(out, begin_ns, max_gap_s, missing, ok, strict)
        sweep = Sweep(points, stamps_ns, at_ns, options)
        moved = deskew(self, sweep, source, fixed_frame)
        assert not isinstance(moved, _core.AskServer)
        return moved

    def gate(
        self: GateLookups,
        target: str,
        *,
        queue_size: int = 100,
        timeout_s: float = 1.0,
        on_drop: Callable[[Dropped[Any]], object] | None = None,
        max_gap_s: float | None = None,
    ) -> Gate:
        """Make a gate, which holds sensor data until its transform exists.

        Args:
            target: Frame to express coordinates in.
            queue_size: Most items that it holds, from 1 to 100,000: those that wait, and those that
                nobody has fetched yet. It drops further ones as `"full"`.
            timeout_s: How long an item may wait for its transform, in seconds, up to 3600.
            on_drop: Called with each item that is dropped, and the reason; see `Dropped`. On a
                thread of the gate, or of the caller of `put` or `close`.
            max_gap_s: Most seconds between two samples of a link to interpolate over; None for any.
                It drops an item beyond it as `"gap"`.

        Returns:
            A `Gate`, to be used in a `with` block.

        Raises:
            InvalidArgumentException: An argument is out of its range.

        Example:
            ``with tf.gate("map") as gate: gate.put(image, "camera", stamp_ns); print(gate.get())``
        """
        from zenoh_tf.gates.gate import Gate  # noqa: PLC0415 - most programs need none

        return Gate(self, target, queue_size, timeout_s, on_drop, max_gap_s)

    def frame(self, name: str) -> FrameInfo:
        """Return what is known about a frame and the link to its parent.

        Args:
            name: The frame.

        Raises:
            LookupException: The frame does not exist.
            InvalidArgumentException: The name is invalid.
        """
        from zenoh_tf.introspection.frame_info import FrameInfo  # noqa: PLC0415 - slow

        return FrameInfo.from_record(self._frame_record(name))

    def explain(self, target: str, source: str, stamp_ns: int | None = None) -> Explanation:
        """Return why a lookup succeeds or fails: the chain link by link, and what limits it.

        Example: `print(tree.explain("map", "camera"))`

        Args:
            target: The lookup's target.
            source: The lookup's source.
            stamp_ns: The lookup's time in nanoseconds; None for the latest common time.

        Returns:
            The explanation, of the tree as of one instant.

        Raises:
            InvalidArgumentException: A name or the stamp is invalid.
        """
        return self._explain(target, source, stamp_ns)

    def _explain(
        self, target: str, source: str, stamp_ns: int | None, now_ns: int | None = None
    ) -> Explanation:
        from zenoh_tf.introspection import explain as explaining  # noqa: PLC0415 - slow
        from zenoh_tf.introspection.frame_info import FrameInfo  # noqa: PLC0415

        records = self._ancestor_records(target, source, stamp_ns)
        frames = [FrameInfo.from_record(record) for record in records]
        names = () if explaining.is_connected(target, source, frames) else self.frames()
        found = explaining.explain(
            target, source, stamp_ns, frames, names, now_ns, recorded=self._is_recorded
        )
        for name in explaining.unknown_frames(found):
            try:
                self.frame(name)
            except ServerStarting as error:
                found = explaining.starting(found, error)
            except LookupException:
                pass
        parents, children = explaining.interpolated(found)
        if not parents:
            return found
        answers = self.lookup_transforms(parents, children, found.at_ns)
        return explaining.with_gaps(found, answers.gaps_ns.tolist())

    def authorities(self) -> list[AuthorityInfo]:
        """Return what each authority has done, in the order of their first commits."""
        from zenoh_tf.introspection.frame_info import AuthorityInfo  # noqa: PLC0415 - slow

        return [AuthorityInfo(**record) for record in self._authority_records()]

    def _repr_html_(self) -> str:
        from zenoh_tf import notebook  # noqa: PLC0415 - most programs need none

        return notebook.of_tree(self)
