"""ROS 2 messages as bytes: tf2_msgs/TFMessage and sensor_msgs/JointState in CDR.

CDR is what ROS 2 sends over every middleware and writes into recordings: a header of four bytes
with the byte order, then the fields in order, each number aligned to its own size. Both byte
orders are read; little-endian is written, as ROS 2 does.

Thread safety: all functions.
Every length is checked against the message before memory is spent on it. A malformed message
raises ProtocolError, and its `field` names the part.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from .._core import TransformRows
from .._core import decode_tf_message as _decode_tf_message
from ..errors import InvalidArgumentException, LimitExceeded, ProtocolError

#: Most transforms, or joints, of one message, unless the caller says otherwise.
MAX_ROWS: Final = 100_000

_HEADER: Final = 4  # bytes; alignment counts from its end
_LITTLE: Final = b"\x00\x01\x00\x00"
_MAX_PADDING: Final = 3  # behind the last field, up to a multiple of four
_SECOND_NS: Final = 1_000_000_000


@dataclass(slots=True)
class JointState:
    """A sensor_msgs/JointState. An array is empty, or has an entry for each name."""

    name: list[str]
    position: NDArray[np.float64]  # (n,) radians, or metres of a sliding joint
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    effort: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    stamp_ns: int = 0
    frame_id: str = ""


def decode_tf_message(
    payload: bytes,
    max_rows: int = MAX_ROWS,
    rename: Callable[[list[str]], list[str]] | None = None,
) -> TransformRows:
    """The transforms of a tf2_msgs/TFMessage.

    Args:
        payload: The message in CDR, with its header.
        max_rows: Most transforms to accept.
        rename: Returns the names that the message's frames have in the tree, in the same order.

    A row whose stamp has a second of nanoseconds or more gets the stamp -2^63, and a name that is
    no UTF-8 a zero at its end. A tree refuses such a row by itself, with "bad_stamp" or "bad_name".

    Raises:
        ProtocolError: The message is malformed.
        LimitExceeded: It has more transforms; `field` is "rows".
    """
    if len(payload) > _HEADER + 4:
        order: Literal["big", "little"] = "big" if payload[1] == 0 else "little"
        _check_rows(int.from_bytes(payload[_HEADER : _HEADER + 4], order), max_rows, len(payload))
    found = _decode_tf_message(payload, rename)
    if isinstance(found, tuple):
        raise _malformed(*found)
    return found


def encode_tf_message(rows: TransformRows) -> bytes:
    """The CDR of a tf2_msgs/TFMessage.

    Raises:
        InvalidArgumentException: A stamp is beyond ROS 2's 32 bits of seconds, or a name has a
            zero character; `field` names it.
    """
    texts = [_encoded(name, "names") for name in rows.names]
    parts = [_LITTLE, struct.pack("<I", len(rows))]
    at = 4
    columns = zip(rows.parent.tolist(), rows.child.tolist(), rows.stamp.tolist(), strict=True)
    poses = np.ascontiguousarray(rows.pose, "<f8")
    for row, (parent, child, stamp_ns) in enumerate(columns):
        head = _stamp(stamp_ns) + texts[parent]
        head += bytes(-len(head) % 4) + texts[child]
        head += bytes(-(at + len(head)) % 8)
        parts += head, poses[row].tobytes()
        at += len(head) + 56
    return b"".join(parts)


def decode_joint_state(payload: bytes, max_rows: int = MAX_ROWS) -> JointState:
    """A sensor_msgs/JointState; velocities or efforts that do not fit the names are left out.

    Args:
        payload: The message in CDR, with its header.
        max_rows: Most joints to accept.

    Raises:
        ProtocolError: The message is malformed.
        LimitExceeded: It has more joints; `field` is "rows".
    """
    read = _Reader(payload, max_rows)
    seconds, rest = read.number("i", 4, "header.stamp.sec"), read.number("I", 4, _NANOSEC)
    if rest >= _SECOND_NS:
        raise _malformed(_NANOSEC, "below 1,000,000,000")
    state = JointState(
        frame_id=read.text("header.frame_id"),
        name=read.texts("name"),
        position=read.doubles("position"),
        velocity=read.doubles("velocity"),
        effort=read.doubles("effort"),
        stamp_ns=seconds * _SECOND_NS + rest,
    )
    read.end()
    count = len(state.name)
    if len(state.position) not in (0, count):
        raise _malformed("position", f"empty or {count} numbers, not {len(state.position)}")
    # Of the others, which move nothing, a number of another joint is none.
    for what in ("velocity", "effort"):
        if len(getattr(state, what)) != count:
            setattr(state, what, np.empty(0))
    return state


def encode_joint_state(state: JointState) -> bytes:
    """The CDR of a sensor_msgs/JointState.

    Raises:
        InvalidArgumentException: The stamp is beyond ROS 2's 32 bits of seconds, or a text has a
            zero character; `field` names it.
    """
    data = bytearray(_stamp(state.stamp_ns) + _encoded(state.frame_id, "frame_id"))
    data += bytes(-len(data) % 4) + struct.pack("<I", len(state.name))
    for name in state.name:
        data += bytes(-len(data) % 4) + _encoded(name, "name")
    for values in (state.position, state.velocity, state.effort):
        data += bytes(-len(data) % 4) + struct.pack("<I", len(values))
        if len(values):
            data += bytes(-len(data) % 8) + np.ascontiguousarray(values, "<f8").tobytes()
    return _LITTLE + data


_NANOSEC: Final = "header.stamp.nanosec"


class _Reader:
    """Reads the fields of a message one after the other."""

    def __init__(self, payload: bytes, max_rows: int) -> None:
        if len(payload) < _HEADER or payload[0] != 0 or payload[1] not in (0, 1):
            raise _malformed("encapsulation", "00 00 or 00 01: plain CDR")
        self._data = payload
        self._at = _HEADER
        self._order = "<" if payload[1] else ">"
        self._max_rows = max_rows

    def number(self, kind: str, size: int, what: str) -> int:
        self._at += -(self._at - _HEADER) % size
        if self._at + size > len(self._data):
            raise _malformed(what, "complete: the message ends before")
        value: int = struct.unpack_from(self._order + kind, self._data, self._at)[0]
        self._at += size
        return value

    def text(self, what: str) -> str:
        size = self.number("I", 4, what)
        if size > len(self._data) - self._at:
            raise _malformed(what, "a text that the message has room for")
        data = self._data[self._at : self._at + size]
        self._at += size
        if data and data[-1]:
            raise _malformed(what, "a text with a zero at its end")
        return data[:-1].decode(errors="backslashreplace")  # no joint of a URDF is called so

    def texts(self, what: str) -> list[str]:
        count = self._count(what, 4)
        return [self.text(f"{what}[{index}]") for index in range(count)]

    def doubles(self, what: str) -> NDArray[np.float64]:
        count = self._count(what, 8)
        if not count:
            return np.empty(0)
        self._at += -(self._at - _HEADER) % 8
        if self._at + 8 * count > len(self._data):
            raise _malformed(what, "complete: the message ends before")
        values = np.frombuffer(self._data, f"{self._order}f8", count, self._at)
        self._at += 8 * count
        return values.astype(np.float64, copy=False)

    def end(self) -> None:
        if (left := len(self._data) - self._at) > _MAX_PADDING:
            raise _malformed("message", f"nothing behind the last field, not {left} bytes")

    def _count(self, what: str, entry_bytes: int) -> int:
        count = self.number("I", 4, what)
        _check_rows(count, self._max_rows, len(self._data))
        if count > (len(self._data) - self._at) // entry_bytes:
            raise _malformed(what, f"a count that the message has room for, not {count}")
        return count


def _check_rows(count: int, max_rows: int, size: int) -> None:
    """Raise LimitExceeded for too many rows. A count that the message has no room for anyway is
    malformed, and found later."""
    if max_rows < count <= size:
        raise LimitExceeded(
            f"the message has {count} rows: the limit is {max_rows}; send fewer at once",
            field="rows",
            limit=max_rows,
            value=count,
        )


def _malformed(what: str, expected: str) -> ProtocolError:
    return ProtocolError(f"CDR field {what} must be {expected}", field=what)


def _stamp(stamp_ns: int) -> bytes:
    seconds, rest = divmod(stamp_ns, _SECOND_NS)
    try:
        return struct.pack("<iI", seconds, rest)
    except struct.error as error:
        raise InvalidArgumentException(
            f"stamp {stamp_ns} ns: ROS 2 has 32 bits for its seconds", field="stamp_ns"
        ) from error


def _encoded(text: str, what: str) -> bytes:
    try:
        data = text.encode() + b"\0"
    except UnicodeEncodeError as error:
        raise InvalidArgumentException(f"{what} has text that is not UTF-8", field=what) from error
    if data.index(0) != len(data) - 1:
        raise InvalidArgumentException(
            f"{what} has a zero character, which ROS 2 cannot send", field=what
        )
    return struct.pack("<I", len(data)) + data
