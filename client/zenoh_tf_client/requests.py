"""Makes requests and parses their replies, without any I/O.

Each function makes the `Request` of the client method of the same name. A request has the
message's body, and `parse`, which turns the reply into the method's result or raises its error.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from zenoh_tf import (
    AuthorityInfo,
    FrameChange,
    FrameInfo,
    LatestTransform,
    StampedTransform,
    Transform,
    TransformArray,
    Velocity,
    wire,
)
from zenoh_tf.errors import (
    InvalidArgumentException,
    ProtocolError,
    TransformException,
)
from zenoh_tf.velocity import interval_ns

from . import columns

T = TypeVar("T")

#: Longest wait of a lookup, in seconds. A longer one is probably in another unit.
MAX_WAIT_S = 3600.0
#: A page costs the server a few milliseconds.
_FRAMES_PER_PAGE = 20_000


class Request(ABC, Generic[T]):
    """One operation of a client."""

    __slots__ = ()

    kind: str  # one of zenoh_tf.keys.OPERATIONS
    wait_s: float  # how long the server itself may wait

    @property
    def writes(self) -> bool:
        return self.kind in ("commit", "admin")

    @abstractmethod
    def body(self) -> wire.Message:
        """The message to send."""

    @abstractmethod
    def parse(self, reply: wire.Message) -> T:
        """Return the result in a reply, or raise its error."""


@dataclass(slots=True)
class Call(Request[T]):
    """Any operation except a lookup of a single row."""

    kind: str
    message: wire.Message
    parser: Callable[[wire.Message], T]
    wait_s: float = 0.0

    def body(self) -> wire.Message:
        return self.message

    def parse(self, reply: wire.Message) -> T:
        return self.parser(reply)


def _raise(error: TransformException) -> Any:
    raise error


#: Makes a result from a row of a reply: (request's row, stamp, newest stamp, pose) -> result
Convert = Callable[[columns.Row, int, int, wire.Pose], T]


@dataclass(slots=True)
class Read(Request[T]):
    """A lookup of a single row; a batch sends neighbouring ones as one operation."""

    row: columns.Row
    convert: Convert[T]
    wait_s: float = 0.0
    failed: Callable[[TransformException], T] = _raise
    kind: str = "lookup"

    def body(self) -> wire.Message:
        body = wire.one_read(*self.row)
        if self.wait_s:
            body["timeout_ns"] = timeout_ns(self.wait_s)
        return body

    def parse(self, reply: wire.Message) -> T:
        one = wire.parse_one_answer(reply)
        if one is not None:
            return self.convert(self.row, *one)
        return self.result(next(wire.parse_lookup_reply(reply, 1).rows()))

    def result(self, answer: wire.AnswerRow) -> T:
        """Return the result in one row of a reply, or raise its error."""
        error, stamp_ns, newest_ns, pose = answer
        return self.failed(error) if error else self.convert(self.row, stamp_ns, newest_ns, pose)


def timeout_ns(timeout_s: float) -> int:
    """Return a time-out in nanoseconds; InvalidArgumentException if it is out of range."""
    if not 0 <= timeout_s <= MAX_WAIT_S:
        raise InvalidArgumentException(
            f"timeout_s must be from 0 to {MAX_WAIT_S:g}, not {timeout_s!r}", field="timeout_s"
        )
    return int(timeout_s * 1e9)


def _stamped(row: columns.Row, stamp_ns: int, _: int, pose: wire.Pose) -> StampedTransform:
    return StampedTransform(row[0], row[1], stamp_ns, Transform.from_pose(pose))


def _latest(row: columns.Row, stamp_ns: int, newest_ns: int, pose: wire.Pose) -> LatestTransform:
    return LatestTransform(row[0], row[1], stamp_ns, Transform.from_pose(pose), newest_ns)


def _yes(*_: object) -> bool:
    return True


def _no(*_: object) -> bool:
    return False


def _time(_row: columns.Row, stamp_ns: int, *_: object) -> int | None:
    return None if stamp_ns == wire.NO_STAMP else stamp_ns


# --- reads


def lookup_transform(
    target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
) -> Read[StampedTransform]:
    return Read(columns.at(target, source, stamp_ns), _stamped, timeout_s)


def can_transform(
    target: str, source: str, stamp_ns: int | None = None, timeout_s: float = 0.0
) -> Read[bool]:
    return Read(columns.at(target, source, stamp_ns), _yes, timeout_s, failed=_no)


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
) -> Request[StampedTransform]:
    lookup = columns.lookup(target, source, None, wire.OP_FULL, 1)
    lookup.stamp = np.array([columns.stamp(target_stamp_ns, "target_stamp_ns")])
    lookup.names.append(fixed_frame)
    lookup.fixed = np.array([len(lookup.names) - 1], np.uint32)
    lookup.source_stamp = np.array([columns.stamp(source_stamp_ns, "source_stamp_ns")])
    lookup.timeout_ns = timeout_ns(timeout_s)
    read = lookup_transform(target, source)  # Its reply has the same form.
    return Call("lookup", wire.lookup_body(lookup), read.parse, timeout_s)


def lookup_latest_transforms_xact(
    pairs: Sequence[tuple[str, str]],
) -> Request[list[LatestTransform]]:
    reads = [lookup_latest_transform_xact(target, source) for target, source in pairs]
    lookup = columns.join([read.row for read in reads])
    lookup.atomic = True

    def parse(reply: wire.Message) -> list[LatestTransform]:
        answer = wire.parse_lookup_reply(reply, len(reads))
        return [read.result(row) for read, row in zip(reads, answer.rows(), strict=True)]

    return Call("lookup", wire.lookup_body(lookup), parse)


def lookup_transforms(
    targets: str | Sequence[str], sources: str | Sequence[str], stamps_ns: ArrayLike | None
) -> Request[TransformArray]:
    rows = columns.rows(targets, sources, stamps_ns)
    op = wire.OP_COMMON if stamps_ns is None else wire.OP_AT
    lookup = columns.lookup(targets, sources, stamps_ns, op, rows)
    lookup.errors = False

    def parse(reply: wire.Message) -> TransformArray:
        answer = wire.parse_lookup_reply(reply, rows)
        return TransformArray(answer.status, answer.stamp, answer.pose)

    return Call("lookup", wire.lookup_body(lookup), parse)


def sample(target: str, source: str, stamps_ns: ArrayLike) -> Request[TransformArray]:
    return lookup_transforms(target, source, stamps_ns)


def lookup_velocity(
    tracking_frame: str,
    observation_frame: str,
    stamp_ns: int | None = None,
    averaging_interval_s: float = 0.1,
    *,
    reference_frame: str | None = None,
    reference_point: ArrayLike = (0.0, 0.0, 0.0),
    reference_point_frame: str | None = None,
) -> Request[Velocity]:
    try:
        (x, y, z) = np.asarray(reference_point, np.float64).tolist()
    except (TypeError, ValueError) as error:
        message = f"reference_point must be 3 numbers, not {reference_point!r}"
        raise InvalidArgumentException(message, field="reference_point") from error
    body = wire.call_body(
        "velocity",
        tracking_frame=tracking_frame,
        observation_frame=observation_frame,
        stamp_ns=_optional_stamp(stamp_ns),
        averaging_interval_ns=interval_ns(averaging_interval_s),
        reference_frame=reference_frame,
        reference_point=wire.raw(np.array([x, y, z]), wire.F64),
        reference_point_frame=reference_point_frame,
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


# --- writes


def set_transform(
    stamped: StampedTransform, authority: str = "", static: bool = False
) -> Request[bool]:
    commit = columns.commit([stamped], authority, static)
    commit.drop_old = True
    return Call(
        "commit",
        wire.commit_body(commit),
        lambda reply: bool(wire.parse_commit_reply(reply, 1)[0]),
    )


def set_transforms_xact(
    stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
) -> Request[None]:
    commit = columns.commit(stampeds, authority, static)

    def parse(reply: wire.Message) -> None:
        wire.parse_commit_reply(reply, commit.rows)

    return Call("commit", wire.commit_body(commit), parse)


def _admin(what: str, **arguments: str | bool) -> Request[None]:
    body = wire.call_body(what, **arguments)
    return Call("admin", body, lambda reply: wire.parse_value(reply, type(None)))


def clear(keep_static: bool = True) -> Request[None]:
    return _admin("clear", keep_static=keep_static)


def reset() -> Request[None]:
    return _admin("reset")


def remove_frame(name: str, subtree: bool = False) -> Request[None]:
    return _admin("remove_frame", name=name, subtree=subtree)


# --- introspection


def _info(kind: type | tuple[type, ...], what: str, **arguments: str | int | None) -> Request[Any]:
    body = wire.call_body(what, **arguments)
    return Call("info", body, lambda reply: wire.parse_value(reply, kind))


def _optional_stamp(stamp_ns: int | None) -> int | None:
    """Check a stamp that may be left out of the message."""
    return None if stamp_ns is None else columns.stamp(stamp_ns)


def hello(
    user: str | None = None,
    client: str | None = None,
    clock_ns: int | None = None,
    round_trip_ns: int | None = None,
) -> Request[dict[str, Any]]:
    """`clock_ns`: this machine's real-time clock. `round_trip_ns`: of the last such request."""
    clocks = {"clock_ns": clock_ns, "round_trip_ns": round_trip_ns}
    return _info(dict, "hello", user=user, client=client, **clocks)


def frames() -> Request[list[str]]:
    return _info(list, "frames")


def frames_page(after: int | None) -> Request[tuple[list[str], int | None]]:
    """A page of the frames, and what to ask for next; None if that was the last page. A server
    that knows no pages sends all frames at once."""

    def parse(reply: wire.Message) -> tuple[list[str], int | None]:
        names = wire.parse_value(reply, list)
        following = wire.integer(reply, "next", low=0) if "next" in reply else None
        if following is not None and following <= (after or 0):
            raise ProtocolError("the pages of frames do not advance", field="next")
        return names, following

    return Call("info", wire.call_body("frames", limit=_FRAMES_PER_PAGE, after=after), parse)


def frame(name: str) -> Request[FrameInfo]:
    def parse(reply: wire.Message) -> FrameInfo:
        record = _record(wire.parse_value(reply, dict), FrameInfo)
        if record["last_change"] is not None:
            record["last_change"] = _record(record["last_change"], FrameChange)
        return FrameInfo.from_record(record)

    return Call("info", wire.call_body("frame", frame=name), parse)


def authorities() -> Request[list[AuthorityInfo]]:
    def parse(reply: wire.Message) -> list[AuthorityInfo]:
        records = wire.parse_value(reply, list)
        return [AuthorityInfo(**_record(record, AuthorityInfo)) for record in records]

    return Call("info", wire.call_body("authorities"), parse)


def _record(value: Any, kind: type[FrameInfo | FrameChange | AuthorityInfo]) -> dict[str, Any]:
    """Return the fields of a record that this client knows: a newer server may send more, and an
    older one leaves out those that have a default."""
    required = {entry.name for entry in fields(kind) if entry.default is MISSING}
    if type(value) is not dict or not required <= value.keys():
        raise ProtocolError(
            f"the {kind.__name__} in the reply lacks some of the fields {sorted(required)}",
            field="value",
        )
    return {entry.name: value[entry.name] for entry in fields(kind) if entry.name in value}


def parent(frame: str, stamp_ns: int | None = None) -> Request[str | None]:
    return _info((str, type(None)), "parent", frame=frame, stamp_ns=_optional_stamp(stamp_ns))


def chain(target: str, source: str, stamp_ns: int | None = None) -> Request[list[str]]:
    return _info(list, "chain", target=target, source=source, stamp_ns=_optional_stamp(stamp_ns))


def stats() -> Request[dict[str, int]]:
    return _info(dict, "stats")
