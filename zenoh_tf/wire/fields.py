"""Messages as bytes, and typed access to their fields. No I/O, no Zenoh.

Thread safety: all functions.
Every getter raises ProtocolError for a missing or malformed field, and its `field` names it.
Columns are read with `numpy.frombuffer`: read-only views of the message, never copies.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterable, Mapping
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from .._core import decoded_size, join_buffers
from ..errors import InvalidArgumentException, LimitExceeded, ProtocolError
from ..text import quoted

VERSION: Final = 1

#: Messages have a few keys, facts and statistics a few dozen.
MAX_MAP_KEYS: Final = 256
#: Longest list (names, errors, operations). A forged header cannot claim more memory.
MAX_LIST: Final = 1 << 20
#: Largest message by default; `--limit message_bytes` of the server changes it.
MAX_MESSAGE_BYTES: Final = 16 << 20
#: Largest reply. The server's replies are far smaller (`--limit reply_bytes`).
MAX_REPLY_BYTES: Final = 256 << 20

U8: Final = np.dtype("u1")
U32: Final = np.dtype("<u4")
U64: Final = np.dtype("<u8")
I64: Final = np.dtype("<i8")
F64: Final = np.dtype("<f8")

Message = dict[str, Any]

_NESTED_TOO_DEEPLY: Final = -2  # returned by decoded_size
_BIN_32: Final = struct.Struct(">BI")
_IN_STEPS_FROM_ROWS: Final = 4000  # of a reply; steps cost a shorter one more than they spare
_IN_STEPS_FROM: Final = 64 * 1024  # bytes of a batch
_FEW: Final = 16  # entries of a column: NumPy's fixed cost would dominate their reduction


class _Packers(threading.local):
    """One packer per thread: to make one costs more than to pack a lookup."""

    def __init__(self) -> None:
        self.packer = msgpack.Packer(buf_size=4096)


_packers = _Packers()


def pack(message: Mapping[str, Any]) -> bytes:
    """The bytes of a message.

    Raises:
        InvalidArgumentException: A value of the caller's is text that is not UTF-8, an integer
            beyond 64 bits, or of a type that has no msgpack form.
    """
    packer = _packers.packer
    try:
        data: bytes = packer.pack(message)
        return data
    except (ValueError, OverflowError, TypeError) as error:
        packer.reset()
        raise InvalidArgumentException(
            f"the arguments cannot be sent: {error}", field="message"
        ) from error


def pack_in_steps(message: Mapping[str, Any]) -> bytes:
    """As `pack`, for a reply that may have many rows. Other threads then get the interpreter
    between the entries of its lists, and while its columns are copied."""
    if len(message.get("status", b"")) < _IN_STEPS_FROM_ROWS:
        return pack(message)
    packer = _packers.packer
    parts: list[bytes | memoryview] = [packer.pack_map_header(len(message))]
    for key, value in message.items():
        parts.append(packer.pack(key))
        if type(value) is memoryview:
            parts += _BIN_32.pack(0xC6, value.nbytes), value
        elif type(value) is list:
            # Not `map`: within one call of `join` nobody else would get the interpreter.
            items = [packer.pack(item) for item in value]
            parts += packer.pack_array_header(len(items)), b"".join(items)
        else:
            parts.append(packer.pack(value))
    return join_buffers(parts)


def unpack(
    payload: bytes,
    max_bytes: int = MAX_MESSAGE_BYTES,
    max_decoded_bytes: int | None = None,
    in_steps: bool = False,
) -> Message:
    """The map of a message. Refuses it before it is decoded, if that would cost too much.
    `in_steps`: it is a batch, and other threads get the interpreter between its operations if it is
    a long one. That costs another copy of the message.

    Raises:
        LimitExceeded: The payload has more than `max_bytes`, or takes more than
            `max_decoded_bytes` of memory when it is decoded.
        ProtocolError: It is not a message, or of another version of the protocol.
    """
    if len(payload) > max_bytes:
        raise LimitExceeded(
            f"the message has {len(payload)} bytes: the limit is {max_bytes} "
            "(--limit message_bytes=N); send fewer rows at once",
            field="message_bytes",
            limit=max_bytes,
            value=len(payload),
        )
    size = decoded_size(payload)
    if size < 0 or (max_decoded_bytes is not None and size > max_decoded_bytes):
        raise _refusal(size, max_decoded_bytes)
    try:
        if in_steps and len(payload) >= _IN_STEPS_FROM:
            message = _unpack_in_steps(payload)
        else:
            message = msgpack.unpackb(
                payload, max_array_len=MAX_LIST, max_map_len=MAX_MAP_KEYS, max_ext_len=0
            )
    except UnicodeDecodeError as error:
        raise ProtocolError(
            "the message has text that is not UTF-8", field=_field_not_utf8(payload)
        ) from error
    except Exception as error:  # msgpack raises half a dozen unrelated classes
        reason = str(error) or type(error).__name__
        raise ProtocolError(
            f"the message is not a msgpack map: {reason}", field="message"
        ) from error
    if type(message) is not dict:
        raise ProtocolError(
            f"the message must be a map, not {type(message).__name__}", field="message"
        )
    version = message.get("v")
    if version != VERSION or type(version) is not int:
        raise ProtocolError(
            f"protocol version {quoted(version)} is not supported: this side has version "
            f"{VERSION}; update the older side",
            field="v",
        )
    return message


def _refusal(size: int, max_bytes: int | None) -> ProtocolError | LimitExceeded:
    """The error of a message that is cut short, nested too deeply, or too dear to decode."""
    if size < 0:
        reason = "nested too deeply" if size == _NESTED_TOO_DEEPLY else "cut short or not msgpack"
        return ProtocolError(f"the message is not a msgpack map: it is {reason}", field="message")
    return LimitExceeded(
        f"the message takes {size} bytes when it is decoded: the limit is {max_bytes} "
        "(--limit decoded_bytes=N); send fewer rows at once",
        field="decoded_bytes",
        limit=max_bytes,
        value=size,
    )


def _unpack_in_steps(payload: bytes) -> Message:
    """The map of a batch. Other threads get the interpreter between its operations, which one
    call of msgpack decodes without a break."""
    unpacker = msgpack.Unpacker(
        raw=False,
        strict_map_key=True,
        max_buffer_size=len(payload),
        max_array_len=MAX_LIST,
        max_map_len=MAX_MAP_KEYS,
        max_ext_len=0,
    )
    unpacker.feed(payload)
    keys = unpacker.read_map_header()
    if keys > MAX_MAP_KEYS:
        raise ValueError(f"{keys} exceeds max_map_len({MAX_MAP_KEYS})")
    message: Message = {}
    for _ in range(keys):
        key = unpacker.unpack()
        if type(key) is not str:
            raise ValueError(f"{type(key).__name__} is not allowed for map key")
        if key == "operations":
            count = unpacker.read_array_header()
            if count > MAX_LIST:
                raise ValueError(f"{count} exceeds max_array_len({MAX_LIST})")
            message[key] = [unpacker.unpack() for _ in range(count)]
        else:
            message[key] = unpacker.unpack()
    if unpacker.tell() != len(payload):
        raise ValueError("it has extra data")
    return message


def _field_not_utf8(payload: bytes) -> str:
    """The path to the first text that is not UTF-8. Decodes the payload once more."""
    try:
        message = msgpack.unpackb(
            payload,
            unicode_errors="surrogateescape",
            max_array_len=MAX_LIST,
            max_map_len=MAX_MAP_KEYS,
            max_ext_len=0,
        )
    except Exception:  # the payload has another defect behind the bad text
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


def malformed(field: str, expected: str) -> ProtocolError:
    """The error of a field that is not as expected."""
    return ProtocolError(f"field {quoted(field)} must be {expected}", field=field)


def texts(message: Message, field: str) -> list[str]:
    value = message.get(field)
    if type(value) is not list or not {str}.issuperset(map(type, value)):
        raise malformed(field, "a list of texts")
    return value


def text(message: Message, field: str, default: str | None = None) -> str:
    value = message.get(field, default)
    if type(value) is not str:
        raise malformed(field, "text")
    return value


def name(message: Message, field: str, max_bytes: int) -> str:
    """A text of at most `max_bytes` in UTF-8.

    Raises:
        LimitExceeded: It is longer.
    """
    value = text(message, field)
    if len(value) * 4 > max_bytes and (size := len(value.encode())) > max_bytes:
        raise LimitExceeded(
            f"{field} is {quoted(value)} of {size} bytes: the limit is {max_bytes}",
            field="name_bytes",
            limit=max_bytes,
            value=size,
        )
    return value


def flag(message: Message, field: str, default: bool = False) -> bool:
    value = message.get(field, default)
    if type(value) is not bool:
        raise malformed(field, "true or false")
    return value


def integer(message: Message, field: str, default: int | None = None, low: int = -(1 << 63)) -> int:
    value = message.get(field, default)
    if type(value) is not int or not low <= value < 1 << 63:
        raise malformed(field, f"an integer of 64 bits, at least {low}")
    return value


def number(message: Message, field: str, default: float | None = None) -> float:
    """A float, which may be infinite or NaN; a msgpack integer stands for the float."""
    value = message.get(field, default)
    if type(value) is not int and type(value) is not float:
        raise malformed(field, "a number")
    return float(value)


def mapping(message: Message, field: str) -> Message:
    value = message.get(field)
    if type(value) is not dict or not all(type(key) is str for key in value):
        raise malformed(field, "a map with text keys")
    return value


def items(message: Message, field: str) -> list[Any]:
    value = message.get(field)
    if type(value) is not list:
        raise malformed(field, "a list")
    return value


def fields_of(record: Any) -> Message:
    """The fields of a dataclass with slots, by their names; without those that are None."""
    fields: Message = {}
    for name in record.__slots__:
        value = getattr(record, name)
        if value is not None:
            fields[name] = value
    return fields


def binary(message: Message, field: str) -> bytes:
    value = message.get(field)
    if type(value) is not bytes:
        raise malformed(field, "binary")
    return value


def column(
    message: Message, field: str, dtype: np.dtype[Any], rows: int | None = None, width: int = 1
) -> NDArray[Any]:
    """A column of `rows` entries (None: any number), each of `width` numbers."""
    value = binary(message, field)
    size = dtype.itemsize * width
    count, rest = divmod(len(value), size)
    if rest:
        raise malformed(field, f"a multiple of {size} bytes, not {len(value)}")
    if rows is not None and count != rows:
        raise malformed(field, f"{rows} rows, not {count}")
    return np.frombuffer(value, dtype) if count else np.empty(0, dtype)


def indexes(message: Message, field: str, rows: int | None, names: int) -> NDArray[np.uint32]:
    """A column of indexes into a list of `names` names, each checked to be below `names`."""
    values = column(message, field, U32, rows)
    if (found := highest(values)) >= names:
        raise malformed(field, f"indexes below {names}, the number of names, not {found}")
    return values


def highest(values: NDArray[np.unsignedinteger[Any]]) -> int:
    """The highest entry of a column; -1 of an empty one."""
    if values.size > _FEW:
        return int(values.max())
    return max(values.tolist(), default=-1)


def raw(values: NDArray[Any], dtype: np.dtype[Any]) -> memoryview | bytes:
    """A column for `pack`: little-endian and contiguous. Copies only what is not so already."""
    return np.ascontiguousarray(values, dtype).data if values.size else b""
