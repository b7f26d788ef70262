"""Decompresses the blocks of recordings, never beyond a size that is known before.

A few bytes may declare or hold gigabytes: what is larger than allowed counts as damage.
"""

from __future__ import annotations

import bz2
from typing import Final

#: Largest chunk before compression: a recorder closes it after some MB, or after one large message.
MAX_CHUNK_BYTES: Final = 256 << 20
#: Largest message with transforms that was compressed by itself.
MAX_MESSAGE_BYTES: Final = 64 << 20
#: How data compressed by zstd begins. No message of an encoding that is read begins so.
ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"


def decompress(compression: str, data: bytes, size: int) -> bytes:
    """The content of a block.

    Args:
        compression: "zstd", "lz4", "bz2", or "" or "none" for none.
        data: The compressed block.
        size: The bytes that it declares to have before compression.

    Raises:
        ValueError: It has another size, declares more than `MAX_CHUNK_BYTES`, or the compression is
            unknown. Its library's error if it is damaged.
    """
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"{size:,} bytes are declared, of which {MAX_CHUNK_BYTES:,} are allowed")
    found = decompress_begin(compression, data, size + 1)
    if len(found) != size:
        raise ValueError(f"{size:,} bytes are declared, which is not its size")
    return found


def decompress_begin(compression: str, data: bytes, max_bytes: int) -> bytes:
    """The content of a block that may be cut off, up to so many bytes. Raises as `decompress`."""
    if compression in ("", "none"):
        return data[:max_bytes]
    if compression == "zstd":
        import zstandard  # noqa: PLC0415 - of the extra

        # No output buffer: its size would be what the data says.
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            return reader.read(max_bytes)
    if compression == "lz4":
        import lz4.frame  # noqa: PLC0415 - of the extra

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_bytes))
    if compression == "bz2":
        return bz2.BZ2Decompressor().decompress(data, max_bytes)
    raise ValueError(f"the compression {compression!r} is unknown")


def decompress_message(data: bytes) -> bytes:
    """A message that was compressed by itself, as by ``ros2 bag record --compression-mode
    message``. Raises ValueError if it is too large, or zstandard's error if it is damaged."""
    import zstandard  # noqa: PLC0415 - of the extra

    declared = zstandard.frame_content_size(data)  # -1: it does not say
    limit = MAX_MESSAGE_BYTES if declared < 0 else min(declared, MAX_MESSAGE_BYTES)
    found = decompress_begin("zstd", data, limit + 1)
    if len(found) > limit:
        raise ValueError(f"a message of more than {limit:,} bytes before compression")
    return found
