"""The channels of an MCAP file, and the messages in its chunks.

A chunk is a compressed block of messages. The ``mcap`` library makes an object of each record,
which takes ten times as long as the loop below.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import Any, Final

from ...text.reasons import reason
from .container import Channel, Choose, RawMessage
from .decompress import MAX_CHUNK_BYTES, decompress, decompress_begin

MAGIC: Final = b"\x89MCAP0\r\n"
#: Before each record: its opcode, and its bytes.
RECORD: Final = struct.Struct("<BQ")
#: Larger records count as damage, but for those that are not read, such as attachments.
MAX_RECORD_BYTES: Final = 256 << 20
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END, FOOTER = 3, 4, 5, 6, 15, 2
#: Of a message: channel, sequence number, log time, publish time.
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
#: Of a chunk: times of its first and last message, size and checksum before compression, and the
#: length of the compression's name, which a length of 8 bytes follows.
CHUNK_HEAD: Final = struct.Struct("<QQQII")
_DATA_LENGTH_BYTES: Final = 8


class McapChannels:
    """The channels that a file has declared so far."""

    def __init__(self, choose: Choose) -> None:
        self._choose = choose
        self._schemas: dict[int, str] = {}
        self.channels: dict[int, Channel | None] = {}  # None: not read

    def add_schema(self, schema: Any) -> None:
        """Add a schema of the library."""
        self._schemas[schema.id] = schema.name

    def add_channel(self, channel: Any) -> None:
        """Add a channel of the library. Its schema must be known."""
        if channel.id not in self.channels:
            name = self._schemas.get(channel.schema_id, "")
            self.channels[channel.id] = self._choose(channel.topic, name, channel.message_encoding)

    def declare(self, opcode: int, data: bytes) -> None:
        """Add the content of a record `SCHEMA` or `CHANNEL`."""
        from mcap import records  # noqa: PLC0415 - an extra
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415

        stream = ReadDataStream(BytesIO(data))
        if opcode == SCHEMA:
            self.add_schema(records.Schema.read(stream))
        else:
            self.add_channel(records.Channel.read(stream))

    def skips(self, begin: bytes) -> bool:
        """Whether a message is of a channel that is declared and not read."""
        number = MESSAGE_HEAD.unpack_from(begin)[0]
        return number in self.channels and self.channels[number] is None

    def record(self, opcode: int, body: bytes) -> tuple[list[RawMessage], str]:
        """The messages of a record, which may be a chunk; and its fault as of `chunk`."""
        if opcode == CHUNK:
            return self.chunk(body)
        return self._messages(RECORD.pack(opcode, len(body)) + body)

    def chunk(self, body: bytes) -> tuple[list[RawMessage], str]:
        """The messages of a chunk that are read, and what is wrong with it, "" for nothing.

        Args:
            body: The content of its record.
        """
        try:
            data = chunk_data(body)
        except OSError:
            raise
        except Exception as error:  # libraries raise any on damage
            return [], f"a chunk cannot be read: {reason(error)}"
        return self._messages(data)

    def chunk_begin(self, body: bytes) -> list[RawMessage]:
        """The messages of a chunk whose record is cut off."""
        return self._messages(chunk_begin(body))[0]

    def _messages(self, data: bytes) -> tuple[list[RawMessage], str]:
        """The messages up to the first damage, and what that is."""
        found: list[RawMessage] = []
        fault = ""
        channels = self.channels
        at, size = 0, len(data)
        while at + RECORD.size <= size:
            opcode, length = RECORD.unpack_from(data, at)
            at += RECORD.size
            end = at + length
            if end > size or not opcode:
                return found, "a chunk has a record that is no record"
            if opcode == MESSAGE and length >= MESSAGE_HEAD.size:
                number, _, log_ns, _ = MESSAGE_HEAD.unpack_from(data, at)
                if of := channels.get(number):
                    found.append(RawMessage(log_ns, of, data[at + MESSAGE_HEAD.size : end]))
                elif number not in channels:
                    fault = "messages of a channel that is not declared"
            elif opcode in (SCHEMA, CHANNEL):
                try:
                    self.declare(opcode, data[at:end])
                except Exception as error:  # the library raises any on damage
                    return found, f"a chunk has a damaged declaration: {reason(error)}"
            at = end
        return found, fault


def chunk_data(body: bytes) -> bytes:
    """The records of a chunk.

    Raises ValueError if the checksum is wrong or the size is not allowed, and any other exception
    of a library if it is damaged.
    """
    from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - an extra
    from mcap.records import Chunk  # noqa: PLC0415

    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    data = decompress(chunk.compression, chunk.data, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
    return data


def chunk_begin(body: bytes) -> bytes:
    """The records of a chunk whose record is cut off; b"" if nothing can be read."""
    if len(body) < CHUNK_HEAD.size:
        return b""
    _, _, size, _, name_bytes = CHUNK_HEAD.unpack_from(body)
    begin = CHUNK_HEAD.size + name_bytes
    try:
        name = body[CHUNK_HEAD.size : begin].decode()
        return decompress_begin(
            name, body[begin + _DATA_LENGTH_BYTES :], min(size, MAX_CHUNK_BYTES)
        )
    except Exception:  # libraries raise any on damage
        return b""
