"""Reads MCAP files, plain or compressed as a whole.

Complete files are read by their index, without the chunks, and the parts of large chunks, that have
nothing to read. Files that
lack their end, as after a crash, or whose summary is missing, incomplete or damaged are read from
the beginning, record by record, up to the last one that can be read.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from ...text.reasons import reason
from ..errors import missing_library
from .container import Choose, ChunkedFile, RawMessage
from .mcap_chunks import (
    CHANNEL,
    CHUNK,
    DATA_END,
    MAGIC,
    MAX_RECORD_BYTES,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD,
    SCHEMA,
    McapChannels,
)
from .mcap_index import CutOff, is_complete, read_summary
from .mcap_sparse import messages_by_index

#: Messages outside of chunks that are put in order together.
_UNCHUNKED: Final = 10_000

#: The last type of records that there is, and the first of those that writers may define.
_LAST_OPCODE, _OWN_OPCODES = DATA_END, 0x80
#: Largest record that is not read, such as an attachment.
_MAX_SKIPPED_BYTES: Final = 1 << 40

_log_time = attrgetter("log_ns")


class McapFile(ChunkedFile):
    """A file, opened for reading."""

    def __init__(self, path: Path, choose: Choose, *, compressed: bool = False) -> None:
        """Open it; `compressed`: the whole file by zstd. Raises RecordingError if the library is
        missing, and ValueError if it is no MCAP file."""
        try:
            import mcap  # noqa: F401, PLC0415 - an extra
        except ImportError as error:
            raise missing_library(error) from error
        self._channels = McapChannels(choose)
        self._wanted: set[int] = set()  # the channels that are read, of the index
        self._chunks: list[Any] = []  # of the index
        self._is_compressed = compressed
        super().__init__(path)

    def _open(self) -> None:
        if self._begin().read(len(MAGIC)) != MAGIC:
            raise ValueError("its first bytes are not those of an MCAP file")
        if self._is_compressed:
            return
        try:
            summary = read_summary(self._file, self._size)
        except CutOff:
            self.is_cut_off = True
            return
        except ValueError as error:
            self._fault = str(error)
            return
        if summary is None:
            return
        statistics = summary.statistics
        self.is_empty = statistics is not None and statistics.message_count == 0
        if is_complete(self._file, self._size, summary):
            self._use_index(summary)

    def _begin(self) -> BinaryIO:
        """The content of the file from its beginning; it can be read, and sought forward."""
        self._file.seek(0)
        if not self._is_compressed:
            return self._file
        import zstandard  # noqa: PLC0415 - of the extra

        reader = zstandard.ZstdDecompressor().stream_reader(self._file, read_across_frames=True)
        return cast(BinaryIO, reader)

    # --- by the index

    def _use_index(self, summary: Any) -> None:
        for schema in summary.schemas.values():
            self._channels.add_schema(schema)
        for channel in summary.channels.values():
            self._channels.add_channel(channel)
        wanted = {number for number, found in self._channels.channels.items() if found}
        self._wanted, self._has_index = wanted, True
        self._chunks = sorted(
            (
                chunk
                for chunk in summary.chunk_indexes
                # Without an index of its messages, only reading the chunk shows it.
                if not chunk.message_index_offsets or wanted & chunk.message_index_offsets.keys()
            ),
            key=attrgetter("message_start_time"),
        )
        if summary.statistics is not None:
            counts = summary.statistics.channel_message_counts
            self.message_count = sum(counts.get(number, 0) for number in wanted)

    def _indexed(self) -> Iterator[tuple[int, list[RawMessage]]]:
        for index in self._chunks:
            at = index.chunk_start_offset
            self._file.seek(min(at, self._size))
            head = self._file.read(RECORD.size)
            opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
            if opcode != CHUNK or length != index.chunk_length - RECORD.size:
                self.damage.note(f"byte {at:,}", "no chunk is where the index says")
                continue
            if length > MAX_RECORD_BYTES:
                self.damage.note(f"byte {at:,}", f"a chunk of {length:,} bytes")
                continue
            fault = ""
            if (listed := messages_by_index(self._file, index, self._wanted)) is not None:
                channels = self._channels.channels
                found = [
                    RawMessage(log_ns, of, data)
                    for number, log_ns, data in listed
                    if (of := channels[number])
                ]
            else:
                self._file.seek(at + RECORD.size)
                found, fault = self._channels.chunk(self._file.read(length))
            if fault:
                self.damage.note(f"byte {at:,}", fault)
            yield index.message_start_time, found

    # --- from the beginning

    def _scanned(self) -> Iterator[tuple[int, list[RawMessage]]]:
        loose: list[RawMessage] = []  # outside of chunks
        for found, is_chunk in self._records():
            loose += found
            if loose and (is_chunk or len(loose) >= _UNCHUNKED):
                yield min(map(_log_time, loose)), loose
                loose = []
        if loose:
            yield min(map(_log_time, loose)), loose

    def _records(self) -> Iterator[tuple[list[RawMessage], bool]]:
        """The messages of each record, and whether it is a chunk."""
        file, at = self._begin(), len(MAGIC)
        channels = self._channels
        while True:
            try:
                file.seek(at)
                head = file.read(RECORD.size)
                if len(head) < RECORD.size:
                    self.is_cut_off = True
                    return
                opcode, length = RECORD.unpack(head)
                if opcode == DATA_END:
                    return
                if not self._is_sound(opcode, length, at):
                    return
                body = self._body(file, opcode, length)
            except OSError:
                raise
            except Exception as error:  # zstandard's, on damage
                self.damage.note(f"byte {at:,} of the content", reason(error))
                return
            if body is None:
                if _LAST_OPCODE < opcode < _OWN_OPCODES:
                    self.damage.note(f"byte {at:,}", f"a record of the unknown type {opcode}")
            elif len(body) < length:
                self.is_cut_off = True
                yield channels.chunk_begin(body) if opcode == CHUNK else [], True
                return
            else:
                found, fault = channels.record(opcode, body)
                if fault:
                    self.damage.note(f"byte {at:,}", fault)
                yield found, opcode == CHUNK
            at += RECORD.size + length

    def _body(self, file: BinaryIO, opcode: int, length: int) -> bytes | None:
        """The content of a record; None if there is nothing to read in it."""
        if opcode == MESSAGE and length >= MESSAGE_HEAD.size:
            begin = file.read(MESSAGE_HEAD.size)
            if len(begin) == MESSAGE_HEAD.size and self._channels.skips(begin):
                return None
            return begin + file.read(length - MESSAGE_HEAD.size)
        return file.read(length) if opcode in (SCHEMA, CHANNEL, CHUNK) else None

    def _is_sound(self, opcode: int, length: int, at: int) -> bool:
        """Whether a record may be one; else all that follows is lost."""
        is_read = opcode in (SCHEMA, CHANNEL, CHUNK, MESSAGE)
        if opcode and length <= (MAX_RECORD_BYTES if is_read else _MAX_SKIPPED_BYTES):
            return True
        self.damage.note(f"byte {at:,}", "no record begins here, so what follows is lost")
        return False
