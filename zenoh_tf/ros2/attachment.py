"""What a publisher of rmw_zenoh sends beside each message: a number, a time, and who it is.

    33 bytes    number (i64), time in ns (i64), 16 (length), 16 bytes of the publisher's id
    32 bytes    the same without the length, which is the same for all
    77 bytes    the same, each field behind its name as text (Jazzy 0.2.3, Humble 0.1.1 and older)

The id is the hash of the publisher's token (XXH3, 128 bits), so a message can be traced to its
node. Other publishers invent an id.

Thread safety: all functions.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from ..errors import ProtocolError

try:
    import xxhash
except ModuleNotFoundError:  # an optional extra
    HAS_GIDS = False
else:
    HAS_GIDS = True

_GID_BYTES: Final = 16
_NOW: Final = struct.Struct("<qqB16s")
_SHORT: Final = struct.Struct("<qq16s")
#: With each field's name before it, and the name's length before that.
_OLD: Final = struct.Struct("<B15sqB16sqB10sB16s")
_OLD_NAMES: Final = (15, b"sequence_number", 16, b"source_timestamp", 10, b"source_gid", 16)


@dataclass(frozen=True, slots=True)
class Attachment:
    """An attachment's fields."""

    number: int  # the publisher counts its messages
    stamp_ns: int  # the publisher's clock
    gid: bytes  # 16 bytes


def decode(data: bytes) -> Attachment:
    """An attachment in any of the layouts.

    Raises:
        ProtocolError: It is in none; `field` is "attachment".
    """
    if len(data) == _NOW.size:
        number, stamp_ns, size, gid = _NOW.unpack(data)
        if size == _GID_BYTES:
            return Attachment(number, stamp_ns, gid)
    elif len(data) == _SHORT.size:
        return Attachment(*_SHORT.unpack(data))
    elif len(data) == _OLD.size:
        n1, name1, number, n2, name2, stamp_ns, n3, name3, size, gid = _OLD.unpack(data)
        if (n1, name1, n2, name2, n3, name3, size) == _OLD_NAMES:
            return Attachment(number, stamp_ns, gid)
    raise ProtocolError(
        f"attachment of {len(data)} bytes: it is not one of rmw_zenoh's", field="attachment"
    )


def encode(attachment: Attachment) -> bytes:
    """The bytes of an attachment, in the layout of today."""
    return _NOW.pack(attachment.number, attachment.stamp_ns, _GID_BYTES, attachment.gid)


def gid_of(token: str) -> bytes | None:
    """The id with which the publisher of a token marks its messages; None without the package
    `xxhash` (the extra ``zenoh-tf[ros2]``)."""
    if not HAS_GIDS:
        return None
    digest: int = xxhash.xxh3_128_intdigest(token.encode())
    return digest.to_bytes(_GID_BYTES, "little")
