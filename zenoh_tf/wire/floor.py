"""The oldest state that a reply may be of, and how old the state is that a reply is of.

A client that may move to another server says in each request which commit it has seen; a server
that lacks that commit answers `ServerBusy`.
"""

from __future__ import annotations

from typing import Any, Final

from .fields import Message, integer, mapping, pack, text

#: Of a request: a map with `instance` and `seq`, the number of a commit of that server instance,
#: which the reply must have seen. The reply then has `seq`, after which it has seen nothing. The
#: instance "" stands for no commit.
FLOOR: Final = "floor"
#: Of a reply: for how long, in nanoseconds, what is answered may be out of date. A server that
#: commits itself does not say it.
AGE_NS: Final = "age_ns"

_FIXED_MAP: Final = 0x80  # with up to 15 entries
_MAP_16: Final = 0xDE
_MOST_FIXED: Final = 15


def with_field(packed: bytes, name: str, value: Any) -> bytes:
    """A packed map of less than 2^16 - 1 entries with one more, which it must not have."""
    entry = pack({name: value})[1:]
    first = packed[0]
    if first == _MAP_16:
        count = int.from_bytes(packed[1:3], "big")
        rest = packed[3:]
    else:
        count = first - _FIXED_MAP
        rest = packed[1:]
    if count < _MOST_FIXED:
        return b"".join((bytes((_FIXED_MAP + count + 1,)), rest, entry))
    return b"".join((bytes((_MAP_16,)), (count + 1).to_bytes(2, "big"), rest, entry))


def floor_field(instance: str, seq: int) -> Message:
    """The field of a request that must see a commit."""
    return {FLOOR: {"instance": instance, "seq": seq}}


def take_floor(request: Message) -> tuple[str, int]:
    """Remove the field from a request that has it: the instance and the number of the commit.
    Raises ProtocolError."""
    fields = mapping(request, FLOOR)
    found = text(fields, "instance"), integer(fields, "seq", low=0)
    del request[FLOOR]
    return found


def parse_age_s(reply: Message) -> float | None:
    """How old what is answered may be, in seconds; None if the reply does not say it. Raises
    ProtocolError."""
    return integer(reply, AGE_NS, low=0) / 1e9 if AGE_NS in reply else None
