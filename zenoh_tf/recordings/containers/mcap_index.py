"""The summary of an MCAP file, if it can be trusted: which chunks have which channels."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from operator import attrgetter
from typing import Any, BinaryIO, Final

from ...text.reasons import reason
from .mcap_chunks import (
    CHUNK,
    DATA_END,
    FOOTER,
    MAGIC,
    MAX_RECORD_BYTES,
    MESSAGE,
    RECORD,
)

_FOOTER: Final = struct.Struct("<QQI")  # begins of summary and of its offsets, checksum
_END_BYTES: Final = RECORD.size + _FOOTER.size + len(MAGIC)
_PIECE_BYTES: Final = 1 << 20


class CutOff(ValueError):
    """The file lacks its end."""


def read_summary(file: BinaryIO, size: int) -> Any | None:
    """The library's summary of a file; None if it has none.

    Raises:
        CutOff: The file lacks its end.
        ValueError: The summary is damaged.
    """
    from mcap.reader import SeekingReader  # noqa: PLC0415 - an extra

    file.seek(max(0, size - _END_BYTES))
    end = file.read(_END_BYTES)
    if len(end) < _END_BYTES or not end.endswith(MAGIC) or end[0] != FOOTER:
        raise CutOff("the file lacks its end")
    begin, _, checksum = _FOOTER.unpack_from(end, RECORD.size)
    if begin == 0:
        return None
    if begin > size:
        raise ValueError("it is said to begin behind the end of the file")
    if checksum and checksum != _checksum(file, begin, size - len(MAGIC) - 4):
        raise ValueError("its checksum is wrong")
    try:
        file.seek(0)
        return SeekingReader(file, record_size_limit=MAX_RECORD_BYTES).get_summary()
    except OSError:
        raise
    except Exception as error:  # the library raises any on damage
        raise ValueError(reason(error)) from error


def is_complete(file: BinaryIO, size: int, summary: Any) -> bool:
    """Whether all messages, channels and schemas can be found by a summary. Writers may leave parts
    of it out."""
    chunks = summary.chunk_indexes
    statistics = summary.statistics
    channels = summary.channels
    return (
        bool(chunks and channels)
        and (statistics is None or statistics.chunk_count == len(chunks))
        and all(
            each.schema_id == 0 or each.schema_id in summary.schemas for each in channels.values()
        )
        and all(each.message_index_offsets.keys() <= channels.keys() for each in chunks)
        and not any(opcode in (MESSAGE, CHUNK, 0) for opcode in _outside(file, size, chunks))
    )


def _outside(file: BinaryIO, size: int, chunks: list[Any]) -> Iterator[int]:
    """The opcodes of the records outside of chunks and their indexes; 0 for one that is none."""
    ends = {
        each.chunk_start_offset: each.chunk_start_offset
        + each.chunk_length
        + each.message_index_length
        for each in sorted(chunks, key=attrgetter("chunk_start_offset"))
    }
    at = len(MAGIC)
    while at < size:
        if (end := ends.get(at)) is not None and end > at:
            at = end
            continue
        file.seek(at)
        head = file.read(RECORD.size)
        if len(head) < RECORD.size:
            yield 0
            return
        opcode, length = RECORD.unpack(head)
        if opcode == DATA_END:
            return
        yield opcode
        if not opcode:
            return
        at += RECORD.size + length


def _checksum(file: BinaryIO, begin: int, end: int) -> int:
    found = 0
    file.seek(begin)
    while begin < end and (piece := file.read(min(_PIECE_BYTES, end - begin))):
        found = zlib.crc32(piece, found)
        begin += len(piece)
    return found
