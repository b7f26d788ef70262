"""Messages as bytes, and typed access to their fields. No I/O, no Zenoh.

Every getter raises ProtocolError whose `field` names the field at fault. Columns are
read with `numpy.frombuffer`: read-only views of the message, never copies.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidArgumentException, LimitExceeded, ProtocolError

VERSION: Final = 1

#: A map of the protocol has a few keys; facts and statistics have a few dozen.
MAX_MAP_KEYS: Final = 256
#: Longest list (names, errors, operations). A header alone can claim no more memory.
MAX_LIST: Final = 1 << 20
#: Default of the largest message; servers have a flag for theirs.
MAX_MESSAGE_BYTES: Final = 16 << 20

U8: Final = np.dtype("u1")
U32: Final = np.dtype("<u4")
U64: Final = np.dtype("<u8")
I64: Final = np.dtype("<i8")
F64: Final = np.dtype("<f8")

Message = dict[str, Any]


class _Packers(threading.local):
    """A packer per thread: making one per message costs more than packing a lookup."""

    def __init__(self) -> None:
        self.packer = msgpack.Packer(buf_size=4096)


_packers = _Packers()


def pack(message: Mapping[str, Any]) -> bytes:
    """The bytes of a message. Raises InvalidArgumentException for text that is not UTF-8
    or an integer beyond 64 bits, which only a caller's argument can contain."""
    packer = _packers.packer
    try:
        data: bytes = packer.pack(message)
        return data
    except (ValueError, OverflowError, TypeError) as error:
        packer.reset()
        raise InvalidArgumentException(f"cannot be sent: {error}", field="message") from error


def unpack(payload: bytes, max_bytes: int = MAX_MESSAGE_BYTES) -> Message:
    """The map of a message, of this protocol's version.

    Raises LimitExceeded for a payload larger than `max_bytes`, else ProtocolError.
    """
    if len(payload) > max_bytes:
        raise LimitExceeded(
            f"a message of {len(payload)} bytes, at most {max_bytes} are allowed",
            field="message_bytes",
            limit=max_bytes,
            value=len(payload),
        )
    try:
        message = _unpack(payload, "strict")
    except UnicodeDecodeError as error:
        raise ProtocolError("text is not UTF-8", field=_field_not_utf8(payload)) from error
    except Exception as error:  # msgpack raises half a dozen unrelated classes
        reason = str(error) or type(error).__name__
        raise ProtocolError(f"not a msgpack map: {reason}", field="message") from error
    if type(message) is not dict:
        raise ProtocolError("a message is a map", field="message")
    if message.get("v") != VERSION or type(message["v"]) is not int:
        raise ProtocolError(
            f"protocol version {message.get('v')!r}, this side speaks {VERSION}", field="v"
        )
    return message


def _unpack(payload: bytes, unicode_errors: str) -> Any:
    size = len(payload)
    return msgpack.unpackb(
        payload,
        raw=False,
        strict_map_key=True,
        unicode_errors=unicode_errors,
        max_array_len=min(size, MAX_LIST),
        max_map_len=MAX_MAP_KEYS,
        max_ext_len=0,
    )


def _field_not_utf8(payload: bytes) -> str:
    """The path to the first text that is not UTF-8, found by decoding once more."""
    try:
        message = _unpack(payload, "surrogateescape")
    except Exception:  # broken in a second way behind the bad text
        return "message"
    return _bad_text(message, "") or "message"


def _bad_text(value: Any, path: str) -> str | None:
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            return path or "message"
        return None
    items: Iterable[tuple[str, Any]] = ()
    if isinstance(value, dict):
        for key in value:
            if _bad_text(key, path):
                return path or "message"
        items = ((f"{path}.{key}" if path else str(key), item) for key, item in value.items())
    elif isinstance(value, list):
        items = ((f"{path}[{index}]", item) for index, item in enumerate(value))
    for item_path, item in items:
        found = _bad_text(item, item_path)
        if found:
            return found
    return None


def wrong(field: str, expected: str) -> ProtocolError:
    return ProtocolError(f"field {field!r} must be {expected}", field=field)


def texts(message: Message, field: str) -> list[str]:
    value = message.get(field)
    if type(value) is not list or not {str}.issuperset(map(type, value)):
        raise wrong(field, "a list of texts")
    return value


def text(message: Message, field: str, default: str | None = None) -> str:
    value = message.get(field, default)
    if type(value) is not str:
        raise wrong(field, "text")
    return value


def flag(message: Message, field: str, default: bool = False) -> bool:
    value = message.get(field, default)
    if type(value) is not bool:
        raise wrong(field, "true or false")
    return value


def integer(message: Message, field: str, default: int | None = None, low: int = -(1 << 63)) -> int:
    value = message.get(field, default)
    if type(value) is not int or not low <= value < 1 << 63:
        raise wrong(field, f"an integer of 64 bits, at least {low}")
    return value


def mapping(message: Message, field: str) -> Message:
    value = message.get(field)
    if type(value) is not dict or not all(type(key) is str for key in value):
        raise wrong(field, "a map with text keys")
    return value


def items(message: Message, field: str) -> list[Any]:
    value = message.get(field)
    if type(value) is not list:
        raise wrong(field, "a list")
    return value


def column(
    message: Message, field: str, dtype: np.dtype[Any], rows: int | None = None, width: int = 1
) -> NDArray[Any]:
    """A column of `rows` entries (any number where None) of `width` numbers each."""
    value = message.get(field)
    if type(value) is not bytes:
        raise wrong(field, "binary")
    size = dtype.itemsize * width
    count, rest = divmod(len(value), size)
    if rest:
        raise wrong(field, f"a multiple of {size} bytes, not {len(value)}")
    if rows is not None and count != rows:
        raise wrong(field, f"{rows} rows, not {count}")
    return np.frombuffer(value, dtype) if count else np.empty(0, dtype)


def indexes(message: Message, field: str, rows: int | None, names: int) -> NDArray[np.uint32]:
    """A column of rows of `names`, each checked to be within it."""
    values = column(message, field, U32, rows)
    if values.size == 1:  # a single lookup must not pay for numpy's reduction
        highest = int(values[0])
    elif values.size:
        highest = int(values.max())
    else:
        return values
    if highest >= names:
        raise wrong(field, f"rows of the {names} names, not {highest}")
    return values


def raw(values: NDArray[Any], dtype: np.dtype[Any]) -> memoryview | bytes:
    """A column as `pack` takes it, little-endian and contiguous, copied only if it is not."""
    return np.ascontiguousarray(values, dtype).data if values.size else b""
