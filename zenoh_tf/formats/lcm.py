"""tf2_msgs.TFMessage in LCM's encoding, as dimos sends it over Zenoh and LCM.

All numbers are big-endian. A fingerprint of the type comes first, then the number of transforms,
and of each: a sequence number, the stamp's seconds and nanoseconds, the parent, the child, and the
pose. A text is its length, which counts a final zero, and its bytes.
"""

from __future__ import annotations

import struct
from typing import Final

from .rows import Row, each, name_of

_FINGERPRINT: Final = bytes.fromhex("c2b8a1c33a8923ec")
_COUNT: Final = struct.Struct(">i")
_STAMP: Final = struct.Struct(">iii")  # sequence number, seconds, nanoseconds
_LENGTH: Final = struct.Struct(">I")
_POSE: Final = struct.Struct(">7d")  # x, y, z, qx, qy, qz, qw


def _rows(data: bytes) -> list[Row]:
    if not data.startswith(_FINGERPRINT):
        raise ValueError("it does not begin as a tf2_msgs.TFMessage of LCM")
    at = len(_FINGERPRINT)
    (count,) = _COUNT.unpack_from(data, at)
    at += _COUNT.size
    rows: list[Row] = []
    for _ in range(count):
        _, seconds, rest = _STAMP.unpack_from(data, at)
        parent, at = _text(data, at + _STAMP.size)
        child, at = _text(data, at)
        rows.append((parent, child, seconds * 10**9 + rest, _POSE.unpack_from(data, at)))
        at += _POSE.size
    if count < 0 or at != len(data):
        raise ValueError("its length is not that of its transforms")
    return rows


def _text(data: bytes, at: int) -> tuple[str, int]:
    (size,) = _LENGTH.unpack_from(data, at)
    begin = at + _LENGTH.size
    end = begin + size
    if size == 0 or end > len(data) or data[end - 1]:
        raise ValueError("a text does not end where it should")
    return name_of(data[begin : end - 1]), end


decode: Final = each(_rows)
