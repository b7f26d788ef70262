"""Lookup messages: any number of reads as columns (docs/reference/protocol.md, "lookup").

A single read has a fast path without numpy, which would be most of its cost: `one_read`,
`parse_one_read`, `one_answer` and `parse_one_answer`. Its messages are the same. If it has no
optional field, the native module packs and parses it (`core/messages/single_lookup.hpp`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .._core import pack_single_lookup
from ..errors import BY_CODE, TransformException
from ..gap_limit import NO_GAPS, NO_LIMIT
from .error_codec import decode_error, encode_error, raise_error
from .fields import (
    F64,
    I64,
    U8,
    U32,
    U64,
    Message,
    column,
    flag,
    indexes,
    integer,
    items,
    malformed,
    pack,
    raw,
    texts,
)

# What a row asks for. The native tree has the same numbers; a test compares them.
OP_AT: Final = 0
OP_COMMON: Final = 1
OP_LATEST: Final = 2
OP_LATEST_XACT: Final = 3
OP_COMMON_TIME: Final = 4
OP_FULL: Final = 5
OPS: Final = 6

#: In columns of stamps: no time is given.
NO_STAMP: Final = -(1 << 63)

_FIRST: Final = struct.pack("<I", 0)
_SECOND: Final = struct.pack("<I", 1)
_STAMP: Final = struct.Struct("<q")
_POSE: Final = struct.Struct("<7d")

Pose = tuple[float, float, float, float, float, float, float]
#: (error, stamp, newest stamp, pose, gap). The error is None if the row has an answer. The newest
#: stamp equals the stamp for rows without one.
AnswerRow = tuple[TransformException | None, int, int, Pose, int]
#: Names and columns of reads, as `Lookup` has them.
LookupColumns = tuple[
    list[str],
    NDArray[np.uint8],
    NDArray[np.uint32],
    NDArray[np.uint32],
    NDArray[np.int64],
    NDArray[np.uint32] | None,
    NDArray[np.int64] | None,
]
_BYTE: Final = tuple(bytes([op]) for op in range(OPS))
_OP_OF: Final = {byte: op for op, byte in enumerate(_BYTE)}


@dataclass(slots=True)
class Lookup:
    """The reads of one request, as columns with a row per read."""

    names: list[str]
    op: NDArray[np.uint8]  # (n,) OP_...
    target: NDArray[np.uint32]  # (n,) indexes into names
    source: NDArray[np.uint32]  # (n,)
    stamp: NDArray[np.int64]  # (n,) ns, or NO_STAMP
    fixed: NDArray[np.uint32] | None = None  # (n,) indexes into names, OP_FULL only
    source_stamp: NDArray[np.int64] | None = None  # (n,) ns, OP_FULL only
    atomic: bool = False
    versions: bool = False
    errors: bool = True
    timeout_ns: int = 0
    max_gap_ns: int = NO_LIMIT

    @property
    def rows(self) -> int:
        return len(self.op)

    @property
    def columns(self) -> LookupColumns:
        """The reads as a native tree takes them."""
        return (
            self.names,
            self.op,
            self.target,
            self.source,
            self.stamp,
            self.fixed,
            self.source_stamp,
        )


def one_read(target: str, source: str, op: int, stamp_ns: int) -> Message:
    """The body of a single read, the same as `lookup_body` makes."""
    return {
        "v": 1,
        "names": [target, source],
        "op": _BYTE[op],
        "target": _FIRST,
        "source": _SECOND,
        "stamp": _STAMP.pack(stamp_ns),
    }


def pack_one_read(target: str, source: str, op: int, stamp_ns: int) -> bytes:
    """The bytes of a single read. Raises InvalidArgumentException as `pack`."""
    packed = pack_single_lookup(target, source, op, stamp_ns)
    return packed or pack(one_read(target, source, op, stamp_ns))


def lookup_body(lookup: Lookup) -> Message:
    """The body of any number of reads. Fields with default values are left out."""
    body: Message = {
        "v": 1,
        "names": lookup.names,
        "op": raw(lookup.op, U8),
        "target": raw(lookup.target, U32),
        "source": raw(lookup.source, U32),
        "stamp": raw(lookup.stamp, I64),
    }
    if lookup.fixed is not None and lookup.source_stamp is not None:
        body["fixed"] = raw(lookup.fixed, U32)
        body["source_stamp"] = raw(lookup.source_stamp, I64)
    if lookup.atomic:
        body["atomic"] = True
    if lookup.versions:
        body["versions"] = True
    if not lookup.errors:
        body["errors"] = False
    if lookup.timeout_ns:
        body["timeout_ns"] = lookup.timeout_ns
    if lookup.max_gap_ns != NO_LIMIT:
        body["max_gap_ns"] = lookup.max_gap_ns
    return body


def parse_lookup(body: Message) -> Lookup:
    names = texts(body, "names")
    op = column(body, "op", U8)
    rows = op.size
    highest = int(op[0]) if rows == 1 else int(op.max()) if rows else 0
    if highest >= OPS:
        raise malformed("op", f"a number below {OPS}, not {highest}")
    lookup = Lookup(
        names,
        op,
        indexes(body, "target", rows, len(names)),
        indexes(body, "source", rows, len(names)),
        column(body, "stamp", I64, rows),
    )
    if len(body) == 6:  # the common case: no optional fields
        if highest == OP_FULL:
            raise malformed("fixed", "given for a lookup through a fixed frame")
        return lookup
    if "fixed" in body or highest == OP_FULL:
        lookup.fixed = indexes(body, "fixed", rows, len(names))
        lookup.source_stamp = column(body, "source_stamp", I64, rows)
    lookup.atomic = flag(body, "atomic")
    lookup.versions = flag(body, "versions")
    lookup.errors = flag(body, "errors", True)
    lookup.timeout_ns = integer(body, "timeout_ns", 0, low=0)
    lookup.max_gap_ns = integer(body, "max_gap_ns", NO_LIMIT, low=NO_GAPS)
    return lookup


def parse_one_read(body: Message) -> tuple[str, str, int, int] | None:
    """(target, source, op, stamp) of a single read as `one_read` makes it. For any other message
    None: `parse_lookup` then parses it or says what is malformed."""
    try:
        if (
            len(body) == (6 if "v" in body else 5)
            and body["target"] == _FIRST
            and body["source"] == _SECOND
        ):
            names = body["names"]
            op = _OP_OF[body["op"]]
            if type(names) is list and op < OP_FULL:
                target, source = names
                if type(target) is type(source) is str:
                    return target, source, op, _STAMP.unpack(body["stamp"])[0]
    except (KeyError, TypeError, ValueError, struct.error):
        pass
    return None


def one_answer(stamp_ns: int, newest_ns: int | None, pose: Pose, gap_ns: int = 0) -> Message:
    """The reply to a single read that has an answer, the same as `lookup_reply` makes."""
    reply: Message = {
        "status": b"\0",
        "stamp": _STAMP.pack(stamp_ns),
        "pose": _POSE.pack(*pose),
        "errors": [],
    }
    if newest_ns is not None:
        reply["newest"] = _STAMP.pack(newest_ns)
    if gap_ns:
        reply["gap"] = _STAMP.pack(gap_ns)
    return reply


def parse_one_answer(reply: Message) -> tuple[int, int, Pose] | None:
    """(stamp, newest, pose) of a well-formed reply to a single read that has an answer without a
    gap. For any other reply None: `parse_lookup_reply` then parses it or says what is malformed."""
    try:
        if reply["status"] == b"\0" and "gap" not in reply:
            stamp = newest = reply["stamp"]
            if "newest" in reply:
                newest = reply["newest"]
            return _STAMP.unpack(stamp)[0], _STAMP.unpack(newest)[0], _POSE.unpack(reply["pose"])
    except (KeyError, TypeError, struct.error):
        pass
    return None


@dataclass(slots=True)
class LookupReply:
    """The answers, in the order of the reads."""

    status: NDArray[np.uint8]  # (n,) 0 or an error's code
    stamp: NDArray[np.int64]  # (n,) ns; OP_LATEST and OP_LATEST_XACT: the oldest stamp used
    newest: NDArray[np.int64] | None  # (n,) ns, of the same two only
    pose: NDArray[np.float64]  # (n, 7) x y z qx qy qz qw of source in target
    errors: dict[int, TransformException] = field(default_factory=dict)
    gap: NDArray[np.int64] | None = None  # (n,) ns; None: all are 0

    def rows(self) -> Iterator[AnswerRow]:
        """The rows as plain Python values."""
        stamps = self.stamp.tolist()
        newests = stamps if self.newest is None else self.newest.tolist()
        gaps = [0] * len(stamps) if self.gap is None else self.gap.tolist()
        columns = zip(self.status.tolist(), stamps, newests, self.pose.tolist(), gaps, strict=True)
        for row, (code, stamp, newest, pose, gap) in enumerate(columns):
            yield self.error(row) if code else None, stamp, newest, tuple(pose), gap

    def error(self, row: int) -> TransformException:
        """The error of a row that failed."""
        kind = BY_CODE.get(int(self.status[row]), TransformException)
        return self.errors.get(row) or kind("the server sent no details of this error")


def lookup_reply(
    lookup: Lookup,
    status: NDArray[np.uint8],
    stamp: NDArray[np.int64],
    newest: NDArray[np.int64],
    pose: NDArray[np.float64],
    errors: Sequence[tuple[int, TransformException]] = (),
    reads: tuple[list[str], NDArray[np.uint64]] | None = None,
    gap: NDArray[np.int64] | None = None,
) -> Message:
    """The reply to `lookup`, without the envelope's "v" and "instance"."""
    reply: Message = {
        "status": raw(status, U8),
        "stamp": raw(stamp, I64),
        "pose": raw(pose, F64),
        "errors": _encoded(errors) if lookup.errors else [],
    }
    op = lookup.op
    if op.size == 1:
        latest = int(op[0]) in (OP_LATEST, OP_LATEST_XACT)
    else:
        latest = bool(((op == OP_LATEST) | (op == OP_LATEST_XACT)).any())
    if latest:
        reply["newest"] = raw(newest, I64)
    if gap is not None:
        reply["gap"] = raw(gap, I64)
    if reads is not None:
        reply["read_names"] = reads[0]
        reply["read_versions"] = raw(reads[1], U64)
    return reply


def _encoded(errors: Sequence[tuple[int, TransformException]]) -> list[Any]:
    encoded: list[Any] = []
    last, body = None, {}
    for row, error in errors:
        if error is not last:  # rows in a row that fail alike share an error
            last, body = error, encode_error(error)
        encoded.append([row, body])
    return encoded


def parse_lookup_reply(reply: Message, rows: int) -> LookupReply:
    """The answers in a reply to `rows` reads. Raises the error that `reply` carries, if any."""
    raise_error(reply)
    status = column(reply, "status", U8, rows)
    answer = LookupReply(
        status,
        column(reply, "stamp", I64, rows),
        column(reply, "newest", I64, rows) if "newest" in reply else None,
        column(reply, "pose", F64, rows, 7).reshape(rows, 7),
        gap=column(reply, "gap", I64, rows) if "gap" in reply else None,
    )
    for entry in items(reply, "errors"):
        row, error = _row_error(entry, rows)
        answer.errors[row] = error
    return answer


def parse_read_set(reply: Message) -> Iterator[tuple[str, int]]:
    """The read set of a lookup with `versions`: frame names and their versions."""
    names = texts(reply, "read_names")
    versions = column(reply, "read_versions", U64, len(names))
    return zip(names, versions.tolist(), strict=True)


def _row_error(entry: Any, rows: int) -> tuple[int, TransformException]:
    if type(entry) is not list or len(entry) != 2 or type(entry[0]) is not int:
        raise malformed("errors", "pairs of a row and an error")
    row, error = entry
    if not 0 <= row < rows:
        raise malformed("errors", f"rows below {rows}, not {row}")
    return row, decode_error(error, "errors")
