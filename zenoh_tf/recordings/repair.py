"""Repairs MCAP files that lack their end or have damaged chunks, whatever their messages are.

The file is read record by record up to the first one that is not complete; of a chunk that is not
complete, the messages up to its end are read. Everything that can be read is written into a new
file, which has an index again. What cannot be read is counted.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

from .containers.mcap_chunks import CHUNK_HEAD, MAGIC, RECORD, chunk_begin, chunk_data
from .containers.mcap_file import McapFile
from .errors import RecordingError, missing_library

#: Larger records count as damage: a recorder closes a chunk after some MB.
_MAX_RECORD_BYTES: Final = 1 << 30
_INDEX: Final = struct.Struct("<HI")  # channel, bytes of the entries
_INDEX_ENTRY_BYTES: Final = 16
_HEADER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX = 1, 3, 4, 5, 6, 7
_ATTACHMENT, _METADATA, _DATA_END = 9, 12, 15


@dataclass(slots=True)
class Repaired:
    """What became of a file.

    Attributes:
        messages: Messages that the new file has.
        lost_messages: Messages that it lacks, as far as their number is known: the index behind a
            damaged chunk says it, but nothing says it of an incomplete one.
        lost_chunks: Chunks that were damaged, or not complete.
        lost_bytes: Bytes that could not be read; of an incomplete chunk, before compression.
        lost_from_ns: From this log time on the messages of the incomplete chunk at the end are
            lost; None if that is not known, or nothing was incomplete.
        lost_to_ns: The log time of its last message.
    """

    messages: int = 0
    lost_messages: int = 0
    lost_chunks: int = 0
    lost_bytes: int = 0
    lost_from_ns: int | None = None
    lost_to_ns: int | None = None


def repair(path: Path, out: Path, on_bytes: Callable[[int], None] | None = None) -> Repaired:
    """Write a new MCAP file with all that can be read of a damaged one.

    Args:
        path: The damaged file, which stays as it is.
        out: The new file; nothing may be there. It is removed after an error.
        on_bytes: Called now and then with the bytes that were read.

    Returns:
        What the new file has, and what was lost.

    Raises:
        RecordingError: It is no MCAP file, needs no repair, or has no complete message; or a
            library is missing.
        OSError: A file cannot be read or written, or `out` exists.
    """
    try:
        from mcap.writer import Writer  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise missing_library(error) from error
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: not an MCAP file; only those can be repaired")
        size = path.stat().st_size
        with out.open("xb") as new:
            try:
                writer = Writer(new)
                copy = _Copy(writer)
                for opcode, body, is_complete in _records(stream, size):
                    if is_complete:
                        copy.add(opcode, body)
                    else:
                        copy.add_end(opcode, body)
                    if on_bytes is not None:
                        on_bytes(stream.tell())
                copy.finish()
                _check(path, copy.found)
            except BaseException:
                out.unlink()
                raise
    return copy.found


def _check(path: Path, found: Repaired) -> None:
    """Raise RecordingError if the new file would be of no use."""
    if not found.messages:
        raise RecordingError(f"{path}: it has no complete message, so nothing can be repaired")
    if found.lost_bytes or found.lost_messages or found.lost_chunks:
        return
    container = McapFile(path, lambda *_: None)
    container.close()
    if not container.is_cut_off:
        raise RecordingError(f"{path}: the file is complete, so there is nothing to repair")


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes, bool]]:
    """The records of the data section as opcode, content, and whether it is complete: the last one
    may not be, and then its content is the rest of the file."""
    while True:
        head = stream.read(RECORD.size)
        if len(head) < RECORD.size:
            yield 0, head, False
            return
        opcode, length = RECORD.unpack(head)
        if opcode == _DATA_END:
            return
        is_complete = bool(opcode) and length <= min(size - stream.tell(), _MAX_RECORD_BYTES)
        yield opcode, stream.read(length if is_complete else _MAX_RECORD_BYTES), is_complete
        if not is_complete:
            return


class _Copy:
    """Writes the records of a file into a new one, whose numbers of schemas and channels differ."""

    def __init__(self, writer: Any) -> None:
        from mcap import records  # noqa: PLC0415 - an extra
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415

        self._kinds, self._stream = records, ReadDataStream
        self._writer = writer
        self._is_started = False
        self._schemas = {0: 0}  # 0: a channel without one
        self._channels: dict[int, int] = {}
        self._is_index_of_lost = False
        self._last_ns = 0  # the log time of the last message
        self.found = Repaired()

    def add(self, opcode: int, body: bytes) -> None:
        """Add a record of the data section, or count it as lost."""
        if opcode == _MESSAGE_INDEX:
            if self._is_index_of_lost and len(body) >= _INDEX.size:
                self.found.lost_messages += _INDEX.unpack_from(body)[1] // _INDEX_ENTRY_BYTES
            return
        self._is_index_of_lost = False
        try:
            if opcode == _CHUNK:
                self._add_chunk(body)
            else:
                self._add_record(opcode, body)
        except OSError:
            raise  # of the disk
        except Exception:  # the library raises any on damage
            self.found.lost_bytes += len(body)
            if opcode == _CHUNK:
                self.found.lost_chunks += 1
                self._is_index_of_lost = True

    def add_end(self, opcode: int, body: bytes) -> None:
        """Add the messages of a chunk that is not complete; of all else, nothing can be read."""
        found = self.found
        found.lost_bytes += len(body)
        if opcode != _CHUNK or len(body) < CHUNK_HEAD.size:
            return
        first_ns, last_ns, size, *_ = CHUNK_HEAD.unpack_from(body)
        found.lost_chunks += 1
        found.lost_from_ns, found.lost_to_ns = first_ns, last_ns
        try:
            read = self._add_records(chunk_begin(body))
        except OSError:
            raise  # of the disk
        except Exception:  # the library raises any on damage
            return
        if not read:
            return
        found.lost_bytes += size - read - len(body)
        found.lost_from_ns = self._last_ns

    def finish(self) -> None:
        """Write the index and the end."""
        self._start()
        self._writer.finish()

    def _add_chunk(self, body: bytes) -> None:
        """Add the records of a chunk, all or none: its checksum is that of all."""
        data = chunk_data(body)
        if self._add_records(data) < len(data):
            raise ValueError("a record is longer than its chunk")

    def _add_records(self, data: bytes) -> int:
        """Add the complete records of a chunk's data. Returns how many bytes they have."""
        at = 0
        while at + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, at)
            end = at + RECORD.size + length
            if end > len(data):
                break
            self._add_record(opcode, data[at + RECORD.size : end])
            at = end
        return at

    def _add_record(self, opcode: int, body: bytes) -> None:
        kinds, data = self._kinds, self._stream(BytesIO(body))
        if opcode == _HEADER:
            header = kinds.Header.read(data)
            self._start(header.profile, header.library)
            return
        self._start()
        if opcode == _SCHEMA:
            schema = kinds.Schema.read(data)
            if schema.id not in self._schemas:
                number = self._writer.register_schema(schema.name, schema.encoding, schema.data)
                self._schemas[schema.id] = number
        elif opcode == _CHANNEL:
            self._add_channel(kinds.Channel.read(data))
        elif opcode == _MESSAGE:
            message = kinds.Message.read(data, len(body))
            if message.channel_id not in self._channels:
                self.found.lost_messages += 1  # its channel was declared where the damage is
                return
            self._writer.add_message(
                self._channels[message.channel_id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
            self.found.messages += 1
            self._last_ns = message.log_time
        elif opcode == _ATTACHMENT:
            a = kinds.Attachment.read(data)
            self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        elif opcode == _METADATA:
            metadata = kinds.Metadata.read(data)
            self._writer.add_metadata(metadata.name, metadata.metadata)

    def _add_channel(self, channel: Any) -> None:
        if channel.id not in self._channels:
            self._channels[channel.id] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                self._schemas[channel.schema_id],
                channel.metadata,
            )

    def _start(self, profile: str = "", library: str = "") -> None:
        if not self._is_started:
            self._writer.start(profile, library)
            self._is_started = True
