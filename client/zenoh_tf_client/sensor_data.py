"""The methods of `TransformClient` for sensor data: point clouds."""

# Made by scripts/sync_client.py from client/zenoh_tf_client/aio/sensor_data.py: edit that.

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike, NDArray

from zenoh_tf.points import Sweep, deskew
from zenoh_tf.shared_tree import AskServer, SharedTree

from .requests import lookups
from .session.shared_reads import SharedReads


class SensorData:
    """A base of `TransformClient`, which says how to read."""

    _reads: SharedReads
    #: The server's memory. Lookups there take so little time that every step before them counts.
    _tree: SharedTree

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
        """Return a sweep's points as if all had been measured at one time.

        A lidar that moves measures each point from elsewhere. This moves every point along with
        the sensor: from `source` at the point's stamp, through the fixed frame, to `source` at
        `at_ns`. All poses are of one state of the tree. The points stay in this process: where the
        server's memory is not mapped, a query fetches the pose at each distinct stamp.

        Args:
            points: (n, 3) or (rows, columns, 3) metres, in `source` at the time of each point. Any
                strides; float32 and float64 are read where they are. NaN stays NaN.
            stamps_ns: The time of each point in integer nanoseconds: (n,), (rows, columns), or what
                broadcasts to it, such as one stamp for each column.
            source: The frame of the sensor.
            fixed_frame: The frame in which the surroundings stand still, such as ``odom``.
            at_ns: The time in nanoseconds to move all points to.
            out: Array of the points' shape to write to, float32 or float64. It may be `points`
                itself, but must not overlap with it otherwise.

        Returns:
            `out`, or a new array of the points' shape and type: metres, in `source` at `at_ns`.

        Raises:
            LookupException: A frame is unknown.
            ConnectivityException: No path connects the two frames.
            ExtrapolationException: A link has no data for one of the times. The error has that time
                and the link's range as fields.
            InvalidArgumentException: An argument is invalid, or the arrays do not fit.
            LimitExceeded: There are more distinct stamps than a message may have rows.
            ServiceException: As for every call; see the class.

        Example:
            ``cloud = tf.deskew(points, stamps_ns, "lidar", "odom", int(stamps_ns.max()))``
        """
        sweep = Sweep(points, stamps_ns, at_ns, out)
        found = deskew(self._tree, sweep, source, fixed_frame)
        if type(found) is not AskServer:
            return found
        return self._reads.ask(found, lookups.deskew(sweep, source, fixed_frame))
