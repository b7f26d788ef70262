"""The requests of lookups. Each function makes that of the client method of the same name.

A lookup that the server's memory has answered makes none (`session/mapped_tree.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import (
    LatestTransform,
    StampedTransform,
    Transform,
    TransformArray,
    TransformTree,
    Velocity,
    wire,
)
from zenoh_tf._core import pack_single_lookup, parse_single_answer
from zenoh_tf.clouds.points import Sweep
from zenoh_tf.errors import (
    InvalidArgumentException,
    ProtocolError,
    TransformException,
)
from zenoh_tf.gap_limit import max_gap_ns
from zenoh_tf.shared_tree import AskServer, SharedTree
from zenoh_tf.velocity import interval_ns

from . import columns
from .request import Call, Request, timeout_ns

T = TypeVar("T")


def _raise(error: TransformException) -> Any:
    raise error


#: Makes a result from a row of a reply: (request's row, stamp, newest stamp, pose) -> result, and
#: the gap behind the pose, if there is one.
Convert = Callable[..., T]


@dataclass(slots=True)
class Read(Request[T]):
    """A lookup of a single row; a batch sends neighbouring ones as one operation."""

    row: columns.Row
    convert: Convert[T]
    wait_s: float = 0.0
    failed: Callable[[TransformException], T] = _raise
    request_type: str = "lookup"
    writes: bool = False

    @property
    def group(self) -> str | None:
        # The reply to a message comes when the last of its lookups has been waited for.
        return None if self.wait_s else self.request_type

    def body(self) -> wire.Message:
        body = wire.one_read(*self.row)
        if self.wait_s:
            body["timeout_ns"] = timeout_ns(self.wait_s)
        return body

    def parse(self, reply: wire.Message) -> T:
        one = wire.parse_one_answer(reply)
        if one is not None:
            stamp_ns, newest_ns, pose = one
            return self.convert(self.row, stamp_ns, newest_ns, Transform.from_pose(pose))
        return self.answer(wire.parse_lookup_reply(reply, 1))

    def payload(self) -> bytes:
        if self.wait_s:
            return wire.pack(self.body())
        return pack_single_lookup(*self.row) or wire.pack(self.body())

    def parse_plain(self, reply: bytes, instance: str) -> tuple[T] | None:
        answer = parse_single_answer(reply, instance)
        return None if answer is None else (self.convert(self.row, *answer),)

    def lookup(self) -> wire.Lookup:
        """Return the row as columns."""
        return columns.join([self.row])

    def answer(self, reply: wire.LookupReply) -> T:
        """Return the result in a reply of one row, or raise its error."""
        return self.result(next(reply.rows()))

    def result(self, answer: wire.AnswerRow) -> T:
        """Return the result in one row of a reply, or raise its error."""
        error, stamp_ns, newest_ns, pose, gap_ns = answer
        if error:
            return self.failed(error)
        return self.convert(self.row, stamp_ns, newest_ns, Transform.from_pose(pose), gap_ns)


@dataclass(slots=True)
class Rows(Request[T]):
    """A lookup of any number of rows."""

    rows: wire.Lookup
    convert: Callable[[wire.LookupReply], T]
    wait_s: float = 0.0
    request_type: str = "lookup"
    writes: bool = False

    def body(self) -> wire.Message:
        return wire.lookup_body(self.rows)

    def parse(self, reply: wire.Message) -> T:
        return self.convert(wire.parse_lookup_reply(reply, self.rows.rows))

    def lookup(self) -> wire.Lookup:
        """Return the columns."""
        return self.rows

    def answer(self, reply: wire.LookupReply) -> T:
        """Return the result in a reply, or raise its error."""
        return self.convert(reply)


#: A lookup of either form.
Lookup = Read[T] | Rows[T]

#: What a lookup of a transaction gives: the server instance, the read set, and a function that
#: returns the result or raises the lookup's error.
VersionedRead = tuple[str, Iterable[tuple[str, int]], Callable[[], T]]


def lookup_transform(
    target: str,
    source: str,
    stamp_ns: int | None = None,
    timeout_s: float = 0.0,
    *,
    max_gap_s: float | None = None,
) -> Lookup[StampedTransform]:
    row = (target, source, wire.OP_COMMON, wire.NO_STAMP)
    if stamp_ns is not None:
        row = columns.at(target, source, stamp_ns)
    read = Read(row, _stamped, timeout_s)
    if max_gap_s is None:
        return read
    lookup = read.lookup()
    lookup.max_gap_ns = max_gap_ns(max_gap_s)
    lookup.timeout_ns = timeout_ns(timeout_s)
    return Rows(lookup, read.answer, timeout_s)


def can_transform(
    target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
) -> Read[bool]:
    row = columns.at(target, source, stamp_ns)
    return Read(row, lambda *_: True, timeout_s, failed=lambda _: False)


def lookup_latest_transform(target: str, source: str) -> Read[LatestTransform]:
    return Read((target, source, wire.OP_LATEST, wire.NO_STAMP), _latest)


def lookup_latest_transform_xact(target: str, source: str) -> Read[LatestTransform]:
    return Read((target, source, wire.OP_LATEST_XACT, wire.NO_STAMP), _latest)


def latest_common_time(a: str, b: str) -> Read[int | None]:
    return Read((a, b, wire.OP_COMMON_TIME, wire.NO_STAMP), _time)


def lookup_transform_full(
    target: str,
    target_stamp_ns: int | None,
    source: str,
    source_stamp_ns: int | None,
    fixed_frame: str,
    timeout_s: float = 0.0,
    *,
    max_gap_s: float | None = None,
) -> Rows[StampedTransform]:
    lookup = columns.lookup(target, source, None, wire.OP_FULL, 1)
    lookup.stamp = np.array([columns.stamp(target_stamp_ns, "target_stamp_ns")])
    lookup.names.append(columns.name(fixed_frame, "fixed_frame"))
    lookup.fixed = np.array([len(lookup.names) - 1], np.uint32)
    lookup.source_stamp = np.array([columns.stamp(source_stamp_ns, "source_stamp_ns")])
    lookup.timeout_ns = timeout_ns(timeout_s)
    lookup.max_gap_ns = max_gap_ns(max_gap_s)
    read = lookup_transform(target, source)  # Its reply has the same form.
    return Rows(lookup, read.answer, timeout_s)


def lookup_latest_transforms_xact(
    pairs: Sequence[tuple[str, str]],
) -> Rows[list[LatestTransform]]:
    reads = [lookup_latest_transform_xact(target, source) for target, source in pairs]
    lookup = columns.join([read.row for read in reads])
    lookup.atomic = True

    def convert(reply: wire.LookupReply) -> list[LatestTransform]:
        return [read.result(row) for read, row in zip(reads, reply.rows(), strict=True)]

    return Rows(lookup, convert)


def lookup_transforms(
    targets: str | Sequence[str],
    sources: str | Sequence[str],
    stamps_ns: ArrayLike | None,
    *,
    max_gap_s: float | None = None,
) -> Rows[TransformArray]:
    rows = columns.rows(targets, sources, stamps_ns)
    op = wire.OP_COMMON if stamps_ns is None else wire.OP_AT
    lookup = columns.lookup(targets, sources, stamps_ns, op, rows)
    lookup.errors = False
    lookup.max_gap_ns = max_gap_ns(max_gap_s)

    def convert(reply: wire.LookupReply) -> TransformArray:
        gaps = np.zeros(rows, np.int64) if reply.gap is None else reply.gap
        found = reply.status, reply.stamp, reply.pose
        return TransformArray._answers(stamps_ns, *found, targets, sources, gaps)

    return Rows(lookup, convert)


def sample(
    target: str, source: str, stamps_ns: ArrayLike, *, max_gap_s: float | None = None
) -> Rows[TransformArray]:
    return lookup_transforms(target, source, stamps_ns, max_gap_s=max_gap_s)


def read_versions(
    tree: SharedTree | TransformTree, instance: str, request: Lookup[T]
) -> VersionedRead[T] | AskServer:
    """Look up in a tree that has the versions of a server instance, as a part of a transaction."""
    lookup = request.lookup()
    rows = tree._read_rows(
        *lookup.columns,
        atomic=lookup.atomic,
        versions=True,
        max_gap_ns=lookup.max_gap_ns,
    )
    if isinstance(rows, AskServer):
        return rows
    status, stamp, newest, pose, errors, read_set, gap = rows
    assert read_set is not None
    names, versions = read_set
    answer = wire.LookupReply(status, stamp, newest, pose, dict(errors), gap)
    return instance, zip(names, versions.tolist(), strict=True), lambda: request.answer(answer)


def with_versions(request: Lookup[T]) -> Request[VersionedRead[T]]:
    """The same, asked of the server."""

    def parse(reply: wire.Message) -> VersionedRead[T]:
        read_set = wire.parse_read_set(reply)
        return wire.text(reply, "instance"), read_set, lambda: request.parse(reply)

    return Call("lookup", request.body() | {"versions": True}, parse)


def deskew(sweep: Sweep, source: str, fixed_frame: str) -> Rows[NDArray[Any]]:
    """The poses at the sweep's times, of one snapshot; the points stay here."""
    times = sweep.times()
    lookup = columns.lookup(fixed_frame, source, times, wire.OP_AT, len(times))
    lookup.atomic = True
    lookup.max_gap_ns = sweep.max_gap_ns

    def convert(reply: wire.LookupReply) -> NDArray[Any]:
        poses = np.ascontiguousarray(reply.pose)
        return sweep.compensate(times, reply.status, poses, reply.error)

    return Rows(lookup, convert)


def lookup_velocity(
    tracking_frame: str,
    observation_frame: str,
    stamp_ns: int | None = None,
    averaging_interval_s: float = 0.1,
    *,
    reference_frame: str | None = None,
    reference_point: ArrayLike = (0.0, 0.0, 0.0),
    reference_point_frame: str | None = None,
    max_gap_s: float | None = None,
) -> Request[Velocity]:
    try:
        (x, y, z) = np.asarray(reference_point, np.float64).tolist()
    except (TypeError, ValueError) as error:
        message = f"reference_point must be 3 numbers, not {reference_point!r}"
        raise InvalidArgumentException(message, field="reference_point") from error
    body = wire.call_body(
        "velocity",
        tracking_frame=columns.name(tracking_frame, "tracking_frame"),
        observation_frame=columns.name(observation_frame, "observation_frame"),
        stamp_ns=columns.optional_stamp(stamp_ns),
        averaging_interval_ns=interval_ns(averaging_interval_s),
        reference_frame=reference_frame,
        reference_point=wire.raw(np.array([x, y, z]), wire.F64),
        reference_point_frame=reference_point_frame,
        max_gap_ns=None if max_gap_s is None else max_gap_ns(max_gap_s),
    )

    def parse(reply: wire.Message) -> Velocity:
        record = wire.parse_value(reply, dict)
        try:
            return Velocity.from_record(record)
        except (KeyError, TypeError, ValueError) as error:
            raise ProtocolError(
                f"the velocity in the reply is malformed: {error!r}", field="value"
            ) from error

    return Call("info", body, parse)


def _stamped(
    row: columns.Row, stamp_ns: int, _: int, pose: Transform, gap_ns: int = 0
) -> StampedTransform:
    if not gap_ns:
        return StampedTransform(row[0], row[1], stamp_ns, pose)
    return StampedTransform(row[0], row[1], stamp_ns, pose, gap_ns=gap_ns)


def _latest(
    row: columns.Row, stamp_ns: int, newest_ns: int, pose: Transform, _: int = 0
) -> LatestTransform:
    return LatestTransform(row[0], row[1], stamp_ns, pose, newest_ns)


def _time(_row: columns.Row, stamp_ns: int, *_: object) -> int | None:
    return None if stamp_ns == wire.NO_STAMP else stamp_ns
