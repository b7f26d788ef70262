"""Reads MCAP files: the container with the ``mcap`` library, the messages of a chunk in one pass.

A chunk is a compressed block of messages. The library makes an object of each record, which takes
ten times as long as the loop below; everything outside of chunks is left to it.

Complete files are read by their index, without the chunks that have no transforms. Files that lack
their end, as after a crash, are read from the beginning up to the last complete chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from .container import Channel, Choose, RawMessage
from .errors import missing_library

#: Larger records count as damage: a recorder closes a chunk after some MB.
MAX_RECORD_BYTES: Final = 1 << 30
#: Messages outside of chunks that are put in order together.
_UNCHUNKED: Final = 10_000

#: Before each record: its opcode, and its bytes.
RECORD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time
_SCHEMA_RECORD: Final = 3
_CHANNEL_RECORD: Final = 4
_MESSAGE_RECORD: Final = 5

_log_time = attrgetter("log_ns")


class McapFile:
    """A file, opened for reading. A `Container`."""

    def __init__(self, path: Path, choose: Choose) -> None:
        """Open it. Raises RecordingError if the library is missing, and what the library raises if
        it is no MCAP file."""
        try:
            from mcap.exceptions import McapError  # noqa: PLC0415 - an extra
            from mcap.reader import make_reader  # noqa: PLC0415
        except ImportError as error:
            raise missing_library(error) from error
        self._stream = path.open("rb")
        self._size = path.stat().st_size
        self._choose = choose
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel | None] = {}  # None: not read
        self._chunks: list[Any] | None = None  # the index; None: there is none
        self.message_count: int | None = None
        self.is_cut_off = False
        try:
            reader = make_reader(self._stream)  # reads the magic bytes
            try:
                summary = reader.get_summary()
            except (McapError, struct.error, UnicodeDecodeError, OSError, ValueError):
                summary = None
                self.is_cut_off = True
        except BaseException:
            self.close()
            raise
        statistics = summary.statistics if summary is not None else None
        self.is_empty = statistics is not None and statistics.message_count == 0
        if summary is not None and summary.chunk_indexes:
            self._use_index(summary)

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def messages(self) -> Iterator[RawMessage]:
        """See `Container.messages`. Chunks may overlap in time."""
        waiting: list[RawMessage] = []
        chunks = self._indexed_chunks() if self._chunks is not None else self._all_chunks()
        for begin_ns, found in chunks:
            if waiting and begin_ns <= waiting[-1].log_ns:
                ready = [message for message in waiting if message.log_ns < begin_ns]
                waiting = [message for message in waiting if message.log_ns >= begin_ns]
            else:
                ready, waiting = waiting, []
            yield from ready
            waiting += found
            waiting.sort(key=_log_time)  # stable: equal times stay in the order of the file
        yield from waiting

    # --- complete files

    def _use_index(self, summary: Any) -> None:
        for schema in summary.schemas.values():
            self._schemas[schema.id] = schema.name
        for record in summary.channels.values():
            self._add_channel(record)
        wanted = {number for number, found in self._channels.items() if found}
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

    def _indexed_chunks(self) -> Iterator[tuple[int, list[RawMessage]]]:
        """Yield (time of the first message, messages with transforms) of each chunk."""
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - an extra
        from mcap.records import Chunk  # noqa: PLC0415

        for index in self._chunks or ():
            self._stream.seek(index.chunk_start_offset + RECORD.size)
            chunk = Chunk.read(ReadDataStream(self._stream))
            yield index.message_start_time, self._messages_in(chunk)

    # --- files without an index

    def _all_chunks(self) -> Iterator[tuple[int, list[RawMessage]]]:
        """As `_indexed_chunks`, from the beginning of the file to its end."""
        from mcap import records as kinds  # noqa: PLC0415 - an extra
        from mcap.stream_reader import StreamReader  # noqa: PLC0415

        self._stream.seek(0)
        reader = StreamReader(self._stream, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
        records = reader.records
        loose: list[RawMessage] = []  # outside of chunks
        while True:
            try:
                record = next(records)
                found = self._messages_in(record) if isinstance(record, kinds.Chunk) else []
            except StopIteration:
                break
            except Exception:
                # The last record is not complete. Anywhere else it is damage.
                if self.is_cut_off and self._stream.tell() >= self._size:
                    break
                raise
            if isinstance(record, kinds.Chunk):
                yield record.message_start_time, found
            elif isinstance(record, kinds.Schema):
                self._schemas[record.id] = record.name
            elif isinstance(record, kinds.Channel):
                self._add_channel(record)
            elif isinstance(record, kinds.Message) and (
                of := self._channels.get(record.channel_id)
            ):
                loose.append(RawMessage(record.log_time, of, record.data))
            if len(loose) >= _UNCHUNKED:
                yield min(map(_log_time, loose)), loose
                loose = []
        if loose:
            yield min(map(_log_time, loose)), loose

    # --- both

    def _add_channel(self, record: Any) -> None:
        self._channels[record.id] = self._choose(
            record.topic, self._schemas.get(record.schema_id, ""), record.message_encoding
        )

    def _messages_in(self, chunk: Any) -> list[RawMessage]:
        """The messages with transforms of a chunk. Learns the channels that it declares."""
        from mcap.stream_reader import get_chunk_data_stream  # noqa: PLC0415 - an extra

        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(size)
        found = []
        channels = self._channels
        at = 0
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            at += RECORD.size
            end = at + length
            if end > size:
                raise ValueError("a record is longer than its chunk")
            if opcode == _MESSAGE_RECORD:
                number, _, log_ns, _ = _MESSAGE.unpack_from(data, at)
                if of := channels.get(number):
                    found.append(RawMessage(log_ns, of, data[at + _MESSAGE.size : end]))
            elif opcode in (_SCHEMA_RECORD, _CHANNEL_RECORD):
                self._declare(opcode, data[at:end])
            at = end
        return found

    def _declare(self, opcode: int, data: bytes) -> None:
        from mcap import records  # noqa: PLC0415 - an extra
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415

        stream = ReadDataStream(BytesIO(data))
        if opcode == _SCHEMA_RECORD:
            schema = records.Schema.read(stream)
            self._schemas[schema.id] = schema.name
        else:
            declared = records.Channel.read(stream)
            if declared.id not in self._channels:
                self._add_channel(declared)
