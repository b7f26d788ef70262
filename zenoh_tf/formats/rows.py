"""What decoders have in common: many messages in, rows out, and the bad ones counted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from .._core import TransformRows
from ..text.reasons import reason


class Decoded(NamedTuple):
    """The rows of many messages."""

    rows: TransformRows
    counts: list[int]  # rows of each message
    malformed: int  # messages that cannot be decoded
    first_fault: str  # what is wrong with the first of them


Decode = Callable[[list[bytes]], Decoded]

_MAX_STAMP: Final = 1 << 63
#: (parent, child, stamp in ns, pose of seven numbers)
Row = tuple[str, str, int, tuple[float, ...]]


def each(decode: Callable[[bytes], list[Row]]) -> Decode:
    """A decoder from one that decodes a message, and may raise any exception."""

    def decode_all(messages: list[bytes]) -> Decoded:
        parts: list[TransformRows] = []
        counts: list[int] = []
        malformed, fault = 0, ""
        for data in messages:
            counts.append(0)
            try:
                found = decode(data)
                parts.append(TransformRows.of_tuples([_checked(row) for row in found]))
                counts[-1] = len(found)
            except ImportError:
                raise
            except Exception as error:
                malformed += 1
                fault = fault or reason(error)
        return Decoded(TransformRows.join(parts), counts, malformed, fault)

    return decode_all


def _checked(row: Row) -> Row:
    """A row whose stamp beyond 64 bits of nanoseconds is one that a tree refuses by itself."""
    return row if abs(row[2]) < _MAX_STAMP else (*row[:2], -_MAX_STAMP, row[3])


def name_of(data: bytes) -> str:
    """A frame's name. One that is no UTF-8 gets a zero, which no frame's name has, so that a tree
    refuses the row and no other."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode(errors="backslashreplace") + "\0"
