"""Few messages of a large MCAP chunk, by the index of its messages.

``ros2 bag record`` does not compress by default, and puts the messages of all topics into the same
chunks. Of a recording with cameras, reading the transforms alone is a hundredth of the work.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, BinaryIO, Final

from .mcap_chunks import CHUNK_HEAD, MESSAGE, MESSAGE_HEAD, RECORD

#: Smaller chunks are read as a whole, and so are those with a message for fewer bytes than this.
_MIN_BYTES: Final = 256 << 10
_BYTES_PER_MESSAGE: Final = 16 << 10
_MAX_MESSAGE_BYTES: Final = 1 << 20


def messages_by_index(
    file: BinaryIO, chunk: Any, wanted: Collection[int]
) -> list[tuple[int, int, bytes]] | None:
    """Read the messages of some channels, in the order of the chunk.

    The checksum of the chunk is not compared, but each message must be what its index says.

    Args:
        file: The file.
        chunk: The library's index of the chunk.
        wanted: The numbers of the channels.

    Returns:
        Channel, log time and content of each; None if the chunk should be read as a whole: it is
        small or compressed, has many such messages, or differs from its index.
    """
    size = chunk.uncompressed_size
    offsets = chunk.message_index_offsets
    if chunk.compression or size < _MIN_BYTES or size != chunk.compressed_size or not offsets:
        return None
    try:
        entries = [
            (offset, log_ns, number)
            for number in wanted & offsets.keys()
            for log_ns, offset in _entries(file, offsets[number], number)
        ]
        if len(entries) * _BYTES_PER_MESSAGE > size:
            return None
        begin = chunk.chunk_start_offset + RECORD.size + CHUNK_HEAD.size + 8
        return [
            (number, log_ns, _message(file, begin + offset, size - offset, number, log_ns))
            for offset, log_ns, number in sorted(entries)
        ]
    except OSError:
        raise
    except Exception:  # the library raises any on damage
        return None


def _entries(file: BinaryIO, at: int, number: int) -> list[tuple[int, int]]:
    """The log times and offsets of a channel's messages in a chunk."""
    from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - an extra
    from mcap.opcode import Opcode  # noqa: PLC0415
    from mcap.records import MessageIndex  # noqa: PLC0415

    file.seek(at)
    opcode, _ = RECORD.unpack(file.read(RECORD.size))
    found = MessageIndex.read(ReadDataStream(file))
    if opcode != Opcode.MESSAGE_INDEX or found.channel_id != number:
        raise ValueError("no index of the channel is here")
    records: list[tuple[int, int]] = found.records
    return records


def _message(file: BinaryIO, at: int, limit: int, number: int, log_ns: int) -> bytes:
    """The content of a message."""
    file.seek(at)
    head = file.read(RECORD.size + MESSAGE_HEAD.size)
    opcode, length = RECORD.unpack_from(head)
    channel, _, logged_ns, _ = MESSAGE_HEAD.unpack_from(head, RECORD.size)
    size = length - MESSAGE_HEAD.size
    if (opcode, channel, logged_ns) != (MESSAGE, number, log_ns) or not (
        0 <= size <= min(limit, _MAX_MESSAGE_BYTES)
    ):
        raise ValueError("no such message is here")
    return file.read(size)
