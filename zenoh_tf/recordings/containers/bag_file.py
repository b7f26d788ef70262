"""Reads ROS 1 bags with the records of ``rosbags``.

Indexed bags are read chunk by chunk by their index. Those without one, as after a crash of
``rosbag record``, and those whose index is damaged are read from the beginning.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from ...text.reasons import reason
from ..errors import missing_library
from .container import Channel, Choose, ChunkedFile, RawMessage
from .decompress import MAX_CHUNK_BYTES, decompress, decompress_begin

_MAGIC: Final = b"#ROSBAG V2.0\n"


class BagFile(ChunkedFile):
    """A ``.bag`` file, opened for reading."""

    def __init__(self, path: Path, choose: Choose) -> None:
        """Open it. Raises RecordingError if rosbags is missing, and ValueError if it is no bag."""
        try:
            from rosbags.rosbag1 import reader as records  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise missing_library(error) from error
        self._records = records
        self._choose = choose
        self._channels: dict[int, Channel | None] = {}  # None: not read
        self._index: dict[int, list[tuple[int, int]]] = {}
        super().__init__(path)

    def _open(self) -> None:
        """Read the header and the index."""
        if self._file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("a bag of a version that is not read, or damaged at its begin")
        header = self._records.Header.read(self._file, self._records.RecordType.BAGHEADER)
        #: Where the first record behind the bag's header is.
        self._begin = self._file.tell() + 4 + self._records.read_uint32(self._file)
        if header.get("encryptor"):
            raise ValueError("the bag is encrypted")
        if header.get_uint64("index_pos") == 0:
            self.is_cut_off = True
            return
        reader = self._records.Reader(self.path)
        try:
            reader.open()
        except Exception as error:  # rosbags raises any on damage
            self._fault = reason(error)
            return
        try:
            self._use_index(reader)
        finally:
            reader.close()

    # --- by the index

    def _use_index(self, reader: Any) -> None:
        counts: Counter[int] = Counter()
        for chunk in reader.chunk_infos:
            counts.update(chunk.connection_counts)
        if counts != {each.id: each.msgcount for each in reader.connections if each.msgcount}:
            self._fault = "it does not list as many messages as the chunks have"
            return
        for connection in reader.connections:
            self._add(connection.id, connection.topic, connection.msgtype)
        self.is_empty = not any(connection.msgcount for connection in reader.connections)
        index = defaultdict(list)
        for number, entries in reader.indexes.items():
            if self._channels.get(number):
                for time_ns, chunk, offset in entries:
                    index[chunk].append((time_ns, offset))
        self.message_count = sum(map(len, index.values()))
        for each in index.values():
            each.sort()
        self._index = dict(sorted(index.items(), key=lambda item: item[1][0]))
        self._has_index = True

    def _indexed(self) -> Iterator[tuple[int, list[RawMessage]]]:
        for at, entries in self._index.items():
            found: dict[int, RawMessage] = {}
            with self._noting(at):
                self._file.seek(at)
                header = self._records.Header.read(self._file, self._records.RecordType.CHUNK)
                data = BytesIO(self._chunk(header))
                try:
                    self._read_listed(data, [offset for _, offset in entries], found)
                except Exception:  # libraries raise any on damage
                    data.seek(0)  # what the index hides may be whole
                    self._read_all(data, found)
                    raise
            yield entries[0][0], _in_file_order(found)

    def _read_listed(self, data: BytesIO, offsets: list[int], found: dict[int, RawMessage]) -> None:
        """Read the messages at those places of a chunk, also behind damaged ones; then raise."""
        fault: Exception | None = None
        for offset in offsets:
            data.seek(offset)
            try:
                while not self._read_record(data, found):  # connections may stand before it
                    pass
            except Exception as error:  # libraries raise any on damage
                fault = fault or error
        if fault is None and len(found) != len(offsets):
            fault = ValueError("the index lists other messages than it has")
        if fault is not None:
            raise fault

    # --- from the beginning

    def _scanned(self) -> Iterator[tuple[int, list[RawMessage]]]:
        at = self._begin
        while at < self._size:
            found: dict[int, RawMessage] = {}
            end = self._size
            with self._noting(at):
                self._file.seek(at)
                header = self._records.Header.read(self._file)
                opcode = header.get_uint8("op")
                if opcode == self._records.RecordType.CONNECTION:
                    return  # the index at the end
                body = self._file.tell()
                size = self._records.read_uint32(self._file)
                end = body + 4 + size
                self.is_cut_off = self.is_cut_off or end > self._size
                if opcode == self._records.RecordType.CHUNK:
                    self._file.seek(body)
                    self._read_all(BytesIO(self._chunk(header, is_whole=end <= self._size)), found)
            if found:
                messages = _in_file_order(found)
                yield min(message.log_ns for message in messages), messages
            at = end

    # --- both

    @contextmanager
    def _noting(self, at: int) -> Iterator[None]:
        """Note what is damaged in a record."""
        try:
            yield
        except OSError:
            raise
        except Exception as error:  # libraries raise any on damage
            if not (self.is_cut_off and not self._has_index and self._file.tell() >= self._size):
                self.damage.note(f"byte {at:,}", f"a record cannot be read: {reason(error)}")

    def _chunk(self, header: Any, *, is_whole: bool = True) -> bytes:
        """The records of a chunk, whose header was read last."""
        size = self._records.read_uint32(self._file)
        if size > MAX_CHUNK_BYTES:
            raise ValueError(f"it has {size:,} bytes, of which {MAX_CHUNK_BYTES:,} are allowed")
        data, compression = self._file.read(size), header.get_string("compression")
        if is_whole:
            return decompress(compression, data, header.get_uint32("size"))
        return decompress_begin(compression, data, MAX_CHUNK_BYTES)

    def _read_all(self, data: BytesIO, found: dict[int, RawMessage]) -> None:
        """Read the records of a chunk from its beginning."""
        while data.tell() < len(data.getbuffer()):
            self._read_record(data, found)

    def _read_record(self, data: BytesIO, found: dict[int, RawMessage]) -> bool:
        """Read a record of a chunk; add its message, by its place, if it is one that is read.
        Returns False for a connection."""
        records, at = self._records, data.tell()
        header = records.Header.read(data)
        opcode, number = header.get_uint8("op"), header.get_uint32("conn")
        if opcode == records.RecordType.CONNECTION:
            more = records.Header.read(data)  # its data is laid out as a header
            self._add(number, header.get_string("topic"), more.get_string("type"))
            return False
        content = records.read_bytes(data, records.read_uint32(data))
        if opcode != records.RecordType.MSGDATA:
            raise ValueError(f"a chunk has a record of type {opcode}")
        if number not in self._channels:
            raise ValueError(f"a message is of topic {number}, which the bag does not have")
        if of := self._channels[number]:
            found[at] = RawMessage(header.get_time("time"), of, content)
        return True

    def _add(self, number: int, topic: str, message_type: str) -> None:
        if number not in self._channels:
            self._channels[number] = self._choose(topic, message_type, "ros1")


def _in_file_order(found: dict[int, RawMessage]) -> list[RawMessage]:
    """The messages of a chunk, which are found by their places."""
    return [found[at] for at in sorted(found)]
