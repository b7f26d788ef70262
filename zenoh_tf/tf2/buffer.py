"""`Buffer`: the API of tf2_ros's buffer, on a tree of its own or on that of a server; and
`BufferInterface`: what scripts may ask of any buffer, and the base of a script's own."""

from __future__ import annotations

import functools
from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from zenoh_tf import StampedTransform, TransformTree
from zenoh_tf.errors import (
    MAY_SUCCEED_LATER,
    ExtrapolationException,
    InvalidArgumentException,
    TransformException,
)
from zenoh_tf.gap_limit import max_gap_ns

from . import frames_text, sources
from .future import TransformFuture
from .messages import TransformStamped, header_of, message_of, stamped_of
from .nearest import look_up_nearest
from .times import Duration, Time, seconds, stamp_ns, time_of
from .transforming import TransformRegistration, do_transform

if TYPE_CHECKING:
    from typing_extensions import Self

    from zenoh_tf_client.tf2.connection import Server

#: The default time-out: do not wait.
NO_WAIT = Duration()
#: The errors that make `can_transform` return False. It raises the others, such as
#: ServerUnavailable, because they say nothing about the transform.
_NOT_POSSIBLE = (*MAY_SUCCEED_LATER, InvalidArgumentException)


class NotImplementedException(Exception):
    """A subclass of `BufferInterface` lacks the method that was called."""


def _lacking(method: str) -> Callable[..., Any]:
    """What stands for a method that a subclass must have."""

    def lacking(self: BufferInterface, *_: Any, **__: Any) -> Any:
        raise NotImplementedException(f"{type(self).__name__} does not implement {method}")

    return lacking


class BufferInterface:
    """The base of `Buffer` and `BufferClient`, and of a script's own buffers.

    A subclass implements `lookup_transform` and `lookup_transform_full`, and `can_transform` and
    `can_transform_full` if the script asks for them; it inherits the transforming of messages.
    Each method that it lacks raises NotImplementedException.
    """

    def __init__(self) -> None:
        #: The table of message types, which all instances share.
        self.registration = TransformRegistration()

    def transform(
        self, object_stamped: Any, target_frame: str, timeout: Any = NO_WAIT, **options: Any
    ) -> Any:
        """Transform a stamped message to another frame, at the time of the message.

        Args:
            object_stamped: A PointStamped, Vector3Stamped, PoseStamped, PolygonStamped,
                WrenchStamped, PoseWithCovarianceStamped or PointCloud2, recognised by its
                attributes, or a message of a type that `TransformRegistration` knows.
            target_frame: The frame to transform to.
            timeout: How long to wait for writes that make the lookup succeed.
            options: Keyword arguments of this buffer's `lookup_transform`.

        Returns:
            A transformed copy.

        Raises:
            TransformException: The lookup failed; see the class. InvalidArgumentException names a
                field of the header that is missing or of a wrong type.
            TypeException: The message is of another kind.
        """
        header = header_of(object_stamped)
        lookup = target_frame, header.frame_id, header.stamp, timeout
        return do_transform(object_stamped, self.lookup_transform(*lookup, **options))

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Any,
        fixed_frame: str,
        timeout: Any = NO_WAIT,
        **options: Any,
    ) -> Any:
        """Transform a stamped message to another frame at `target_time`; see `transform`.

        The message is assumed not to move in `fixed_frame` between its time and `target_time`.
        """
        header = header_of(object_stamped)
        lookup = target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        return do_transform(object_stamped, self.lookup_transform_full(*lookup, **options))

    lookup_transform: Any = _lacking("lookup_transform")
    lookup_transform_full: Any = _lacking("lookup_transform_full")
    can_transform: Any = _lacking("can_transform")
    can_transform_full: Any = _lacking("can_transform_full")


class Buffer(BufferInterface):
    """A tree of its own, which a `TransformListener` or `set_transform` fills, without a server;
    the server's tree, whose writes are for all clients, if the process has called `connect`.

    Lookups return `TransformStamped`, the pose of source in target (``X_target_source``, metres),
    and raise tf2's exceptions. Times and durations are rclpy's or builtin_interfaces', or numbers
    of seconds; time 0 means the latest common time. A waiting lookup ends with the write that makes
    it succeed, or at once if none can.

    A lookup raises LookupException (a frame is unknown), ConnectivityException (no path connects
    the two), ExtrapolationException (a link has no data for the time), InvalidArgumentException (a
    name or time is invalid). On a server's tree every method raises ServerUnavailable if none
    answers, and a write that raises OutcomeUnknown may or may not have been applied.

    Thread safety: all methods.

    Args:
        cache_time: How long to keep samples, counted back from the newest of their link; None for
            10 s. Has no effect on a server's tree: its ``--cache-time`` decides.
        node: Has no effect: there is no service to make.
        max_gap_s: Most seconds between two samples of a link that any lookup interpolates over;
            None for any, as in tf2. Beyond it a lookup raises GapTooLong, an
            ExtrapolationException.
        source: Where to look up in place of that, for this package.
    """

    #: Whose tree it is in any case; None: as `connect` decides.
    _server: ClassVar[Server | None] = None

    def __init__(
        self,
        cache_time: Any = None,
        node: Any = None,
        *,
        max_gap_s: float | None = None,
        source: sources.Source | None = None,
    ) -> None:
        super().__init__()
        self._max_gap_s = max_gap_s
        source = source or self._server or sources.connected()
        if source is None:
            tree = (
                TransformTree()
                if cache_time is None
                else TransformTree(seconds(cache_time, "cache_time"))
            )
            source = sources.OwnTree(tree)
        self._source = source

    @classmethod
    def from_recording(
        cls, path: str | PathLike[str], *, max_gap_s: float | None = None, **options: Any
    ) -> Self:
        """Make a buffer with the whole history of a recording, in a tree of its own.

        Args:
            path: As of `TransformTree.from_recording`, which says what it raises.
            max_gap_s: As of the class.
            options: Keyword arguments of `TransformTree.from_recording`, such as `topics`.
        """
        tree = TransformTree.from_recording(path, **options)
        return cls(max_gap_s=max_gap_s, source=sources.OwnTree(tree))

    @property
    def is_on_server(self) -> bool:
        """Whether the tree is a server's."""
        return not isinstance(self._source, sources.OwnTree)

    # --- lookups

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = NO_WAIT,
        *,
        max_gap_s: float | None = None,
        nearest_s: float | None = None,
    ) -> TransformStamped:
        """Look up the pose of a frame in another frame, interpolated.

        Args:
            target_frame: The frame to express the pose in.
            source_frame: The frame whose pose is asked for.
            time: The time; Time() for the latest common time.
            timeout: How long to wait for writes that make the lookup succeed.
            max_gap_s: As of the class, for this lookup.
            nearest_s: If there is no data for the time, after the time-out, answer for the nearest
                time that has data, at most so many seconds away; None: raise.

        Returns:
            ``X_target_source``, stamped with the time that was used, which is 0 for the latest
            time of a path of static links only.

        Raises:
            TransformException: The lookup failed; see the class.
        """
        lookup = target_frame, source_frame, stamp_ns(time), seconds(timeout)
        return message_of(self._look_up(*lookup, self._gap(max_gap_s), _within_ns(nearest_s)))

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = NO_WAIT,
        *,
        max_gap_s: float | None = None,
        nearest_s: float | None = None,
    ) -> TransformStamped:
        """Look up the pose of a frame at one time in another frame at another time.

        Args:
            target_frame: The frame to express the pose in.
            target_time: The time of `target_frame`.
            source_frame: The frame whose pose is asked for.
            source_time: The time of `source_frame`.
            fixed_frame: The frame that is assumed not to move between the two times.
            timeout: How long to wait for writes that make the lookup succeed.
            max_gap_s: As of the class, for this lookup.
            nearest_s: As of `lookup_transform`, for each of the two times. Then two lookups answer,
                between which the tree may change.

        Returns:
            ``X_target_source`` between the two times, stamped with the one that was used for the
            target.

        Raises:
            TransformException: The lookup failed; see the class.
        """
        times = stamp_ns(target_time, "target_time"), stamp_ns(source_time, "source_time")
        gap = self._gap(max_gap_s)
        within_ns = _within_ns(nearest_s)
        lookup = target_frame, times[0], source_frame, times[1], fixed_frame, seconds(timeout)
        try:
            return message_of(self._source.tree().lookup_transform_full(*lookup, max_gap_s=gap))
        except TransformException as error:
            _name_timeout(error)
            if within_ns < 0 or not isinstance(error, ExtrapolationException):
                raise
        to = self._look_up(target_frame, fixed_frame, times[0], 0.0, gap, within_ns)
        of = self._look_up(fixed_frame, source_frame, times[1], 0.0, gap, within_ns)
        X_target_source = to.transform @ of.transform
        found = StampedTransform(target_frame, source_frame, to.stamp_ns, X_target_source)
        return message_of(found)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = NO_WAIT,
        return_debug_tuple: bool = False,
        **options: Any,
    ) -> bool | tuple[bool, str]:
        """Return whether `lookup_transform` with the same arguments would succeed.

        With `return_debug_tuple` it returns a tuple of that and the error's text. `options` are the
        keyword arguments of the lookup.
        """
        lookup = target_frame, source_frame, time, timeout
        answer = _attempt(lambda: self.lookup_transform(*lookup, **options))
        return answer if return_debug_tuple else answer[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = NO_WAIT,
        return_debug_tuple: bool = False,
        **options: Any,
    ) -> bool | tuple[bool, str]:
        """As `can_transform`, of `lookup_transform_full`."""
        lookup = target_frame, target_time, source_frame, source_time, fixed_frame, timeout
        answer = _attempt(lambda: self.lookup_transform_full(*lookup, **options))
        return answer if return_debug_tuple else answer[0]

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time:
        """Return the newest time that every link between two frames can serve.

        It is Time() if all links are static. Raises as `lookup_transform`.
        """
        return time_of(self._source.tree().latest_common_time(target_frame, source_frame) or 0)

    # --- lookups that wait until they succeed

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Any, *, max_gap_s: float | None = None
    ) -> TransformFuture:
        """Start a `lookup_transform` that waits until it succeeds; return its future."""
        lookup, gap = (target_frame, source_frame, stamp_ns(time)), self._gap(max_gap_s)
        return TransformFuture(
            self._source.waits,
            lambda tree, wait_s: tree.lookup_transform(*lookup, wait_s, max_gap_s=gap),
        )

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        *,
        max_gap_s: float | None = None,
    ) -> TransformFuture:
        """Start a `lookup_transform_full` that waits until it succeeds; return its future."""
        times = stamp_ns(target_time, "target_time"), stamp_ns(source_time, "source_time")
        gap = self._gap(max_gap_s)
        lookup = target_frame, times[0], source_frame, times[1], fixed_frame
        return TransformFuture(
            self._source.waits,
            lambda tree, wait_s: tree.lookup_transform_full(*lookup, wait_s, max_gap_s=gap),
        )

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Any, **options: Any
    ) -> TransformStamped:
        """Return what `lookup_transform` returns, once it succeeds. Raises what it raises."""
        return await self.wait_for_transform_async(target_frame, source_frame, time, **options)

    async def lookup_transform_full_async(self, *lookup: Any, **options: Any) -> TransformStamped:
        """Return what `lookup_transform_full` returns, once it succeeds.

        It has the arguments of `wait_for_transform_full_async`.
        """
        return await self.wait_for_transform_full_async(*lookup, **options)

    # --- writes

    def set_transform(self, transform: Any, authority: str) -> None:
        """Store a TransformStamped as `authority`, and wait until the tree has it.

        It is dropped if it is older than the cache time. InvalidArgumentException for a transform
        that tf2 would ignore.
        """
        self._source.tree().set_transform(stamped_of(transform), authority)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Store a TransformStamped that holds at all times; see `set_transform`."""
        self._source.tree().set_transform(stamped_of(transform), authority, static=True)

    def clear(self) -> None:
        """Forget all samples in the tree. Static transforms stay."""
        self._source.tree().clear()

    # --- introspection

    def all_frames_as_yaml(self) -> str:
        """Return all frames that have a parent as a YAML map with tf2's keys; seconds, hertz."""
        return frames_text.as_yaml(self._source.frames())

    def all_frames_as_string(self) -> str:
        """Return one sentence for each frame that has a parent."""
        return frames_text.as_string(self._source.frames())

    def _look_up(
        self,
        target: str,
        source: str,
        stamp: int | None,
        wait_s: float,
        gap: float | None,
        within_ns: int,
    ) -> StampedTransform:
        """Look up at a time, or the one nearest to it; see `lookup_transform`."""
        tree = self._source.tree()
        look_up = functools.partial(tree.lookup_transform, target, source, max_gap_s=gap)
        try:
            return look_up(stamp, wait_s)
        except TransformException as error:
            _name_timeout(error)
            if within_ns < 0 or stamp is None or not isinstance(error, ExtrapolationException):
                raise
            return look_up_nearest(look_up, stamp, error, within_ns)

    def _gap(self, max_gap_s: float | None) -> float | None:
        return self._max_gap_s if max_gap_s is None else max_gap_s


def _within_ns(nearest_s: float | None) -> int:
    """Return the tolerance of a lookup in nanoseconds; negative if it has none."""
    return max_gap_ns(nearest_s, -1, "nearest_s")


def _name_timeout(error: TransformException) -> None:
    """Give a tree's error the name of the shim's argument."""
    if error.field == "timeout_s":
        error.field = "timeout"


def _attempt(lookup: Callable[[], TransformStamped]) -> tuple[bool, str]:
    try:
        lookup()
    except _NOT_POSSIBLE as error:
        if isinstance(error, TypeError):  # a mistake of the script's, whatever the tree has
            raise
        return False, str(error)
    return True, ""
