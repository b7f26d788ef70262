"""What requests to a replica and its replies have beside the usual fields."""

from __future__ import annotations

from typing import Any, Final

from ..errors import ReplicaBehind
from .fields import Message, integer, mapping, pack

#: Of a reply: a map with `seq`, the number of a commit that the read has seen; `reach`, the number
#: after which it has seen nothing; and `age_ns`.
REPLICA: Final = "replica"
#: Of a request: the commit that the read must see, and the instance of the server that numbered it.
LEAST_SEQ: Final = "least_seq"
LEAST_INSTANCE: Final = "least_instance"
#: Of a request: true if the server's reply shall have `seq`, after which the read saw nothing.
WITH_SEQ: Final = "with_seq"

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


def least(instance: str, seq: int) -> Message:
    """The fields of a request that must see a commit."""
    return {LEAST_INSTANCE: instance, LEAST_SEQ: seq}


def parse_replica(reply: Message) -> tuple[int, int, int] | None:
    """The number of a commit that a replica's reply has seen, its age in nanoseconds, and the
    number after which it has seen nothing. None: it is not a replica's. Raises ProtocolError."""
    if REPLICA not in reply:
        return None
    fields = mapping(reply, REPLICA)
    seq = integer(fields, "seq", low=0)
    return seq, integer(fields, "age_ns", low=0), integer(fields, "reach", seq, low=0)


def is_behind(reply: Message) -> bool:
    """Whether a replica refuses a read because it lacks what the client must see."""
    error = reply.get("error")
    return type(error) is dict and error.get("code") == ReplicaBehind.code
