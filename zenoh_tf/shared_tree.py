"""A tree of another process on this host, read through shared memory.

The owner is a `TransformTree` made with `_shared=True`, which raises OSError where the host cannot.
It hands out the file descriptor `_region_fd()`, which stays the tree's. Others trust what they
read until its lease ends. So it begins one with `_begin_lease(seconds)`, and again before it ends,
as long as no other server can have taken over. `_begin_lease(0)` ends it. For one thread at a time.

Internal: for `zenoh_tf_server`, which shares its tree, and `zenoh_tf_client`, which reads it.

Reads write nothing, wait for nobody for long, and never return what the owner's successor may have
changed. Where that leaves no answer they return an `AskServer`, which says why.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from zenoh_tf import _core
from zenoh_tf._core import AskServer, RegionRefused
from zenoh_tf.array import TransformArray
from zenoh_tf.estimate import TreeEstimates
from zenoh_tf.gap_limit import max_gap_ns
from zenoh_tf.velocity import Velocity, interval_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from zenoh_tf.introspection.frame_info import FrameInfo

__all__ = ["AskServer", "RegionRefused", "SharedTree"]

# Transforms are true. So one branch shows that there is no answer; the type would take 20 ns. A
# class is no method, so it is called without arguments: `bool()` is False, without a Python frame.
setattr(AskServer, "__bool__", bool)  # noqa: B010
# Members are compared by identity. That of `Enum` is in Python, and takes as long as a lookup.
setattr(AskServer, "__hash__", object.__hash__)  # noqa: B010


class SharedTree(_core.SharedTree):
    """A tree of another process, mapped read-only. Any thread may call any method.

    Every method is `TransformTree`'s, raises the same errors, and returns an `AskServer` if it
    cannot answer: `BUSY` (writers changed what was read again and again, or one stopped while it
    wrote), `LAPSED` (the owner has ended or stopped), `WAITING` (with a time-out: the answer is not
    there yet, and only the server can wait for it) or `UNREADABLE` (the memory is corrupt).

    Args:
        fd: File descriptor of the owner's region. The caller may close it afterwards.

    Raises:
        RegionRefused: This process cannot read the region; the message says why.
    """

    def lookup_transforms(
        self,
        targets: str | Sequence[str],
        sources: str | Sequence[str],
        stamps_ns: ArrayLike | None,
        *,
        max_gap_s: float | None = None,
    ) -> TransformArray | AskServer:
        """As `TransformTree.lookup_transforms`."""
        columns = self._lookup_columns(targets, sources, stamps_ns, max_gap_s)
        if isinstance(columns, AskServer):
            return columns
        status, stamps, poses, gaps = columns
        return TransformArray._answers(stamps_ns, status, stamps, poses, targets, sources, gaps)

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
    ) -> Velocity | AskServer:
        """As `TransformTree.lookup_velocity`."""
        record = self._velocity_record(
            tracking_frame,
            observation_frame,
            stamp_ns,
            interval_ns(averaging_interval_s),
            reference_frame,
            reference_point,
            reference_point_frame,
            max_gap_ns(max_gap_s),
        )
        return record if isinstance(record, AskServer) else Velocity.from_record(record)

    _now_ns: Callable[[], int] = time.time_ns
    estimate_transform = TreeEstimates.estimate_transform
    estimate_transforms = TreeEstimates.estimate_transforms

    def frame(self, name: str) -> FrameInfo | AskServer:
        """As `TransformTree.frame`."""
        from zenoh_tf.introspection.frame_info import FrameInfo  # noqa: PLC0415 - slow

        record = self._frame_record(name)
        return record if isinstance(record, AskServer) else FrameInfo.from_record(record)

    def ancestors(
        self, target: str, source: str, stamp_ns: int | None
    ) -> list[FrameInfo] | AskServer:
        """Return the frames from both up to their roots, each once, as of one instant.

        Args:
            target: One frame; left out if it is unknown.
            source: The other frame.
            stamp_ns: Time of the links in nanoseconds; None for the newest, which also stand for
                links without data at the time.

        Raises:
            InvalidArgumentException: A name or the stamp is invalid.
        """
        from zenoh_tf.introspection.frame_info import FrameInfo  # noqa: PLC0415 - slow

        records = self._ancestor_records(target, source, stamp_ns)
        if isinstance(records, AskServer):
            return records
        return [FrameInfo.from_record(record) for record in records]
