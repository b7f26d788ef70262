"""Messages of batches, info and admin requests (docs/reference/protocol.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import msgpack

from ..errors import ProtocolError
from ..text import quoted
from .error_codec import raise_error
from .fields import VERSION, Message, items, malformed

#: The request types that a batch may have.
BATCH_TYPES: Final = ("lookup", "commit", "info")
#: The field with what is counted for each robot (`--mirror-of`).
_ROBOTS = "robots"


def batch_body(operations: Sequence[tuple[str, Message]]) -> Message:
    """The body of a batch: an ordered list of operations with a common reply."""
    return {"v": 1, "operations": [list(operation) for operation in operations]}


def parse_batch(body: Message) -> list[tuple[str, Message]]:
    """The operations of a batch, as pairs of request type and body. Bodies are parsed when
    they run, so that a malformed one fails alone."""
    operations: list[tuple[str, Message]] = []
    for index, entry in enumerate(items(body, "operations")):
        if type(entry) is not list or len(entry) != 2 or type(entry[1]) is not dict:
            raise malformed(f"operations[{index}]", "a pair of request type and body")
        request_type, request = entry
        if type(request_type) is not str or request_type not in BATCH_TYPES:
            raise malformed(
                f"operations[{index}]",
                f"one of {', '.join(BATCH_TYPES)}, not {quoted(request_type)}",
            )
        operations.append((request_type, request))
    return operations


def batch_reply(replies: Sequence[bytes], instance: str) -> bytes:
    """The bytes of the reply to a batch, from those of its operations' replies."""
    packer = msgpack.Packer()
    return b"".join(
        (
            packer.pack_map_header(3),
            *map(packer.pack, ("v", VERSION, "instance", instance, "replies")),
            packer.pack_array_header(len(replies)),
            *replies,
        )
    )


def parse_batch_reply(reply: Message, count: int) -> list[Message]:
    """The replies in the order of the operations. Raises the error that `reply` carries, if any."""
    raise_error(reply)
    replies = items(reply, "replies")
    if len(replies) != count or not all(type(entry) is dict for entry in replies):
        raise malformed("replies", f"{count} maps")
    return replies


def call_body(what: str, **arguments: Any) -> Message:
    """The body of an `info` or `admin` request; arguments that are None are left out."""
    body: Message = {"v": 1, "what": what}
    body.update((name, value) for name, value in arguments.items() if value is not None)
    return body


def parse_value(reply: Message, kind: type | tuple[type, ...]) -> Any:
    """The value of an `info` or `admin` reply. Raises ProtocolError if it is not of `kind`."""
    raise_error(reply)
    value = reply.get("value")
    if not isinstance(value, kind):
        expected = kind if isinstance(kind, tuple) else (kind,)
        names = " or ".join(each.__name__ for each in expected)
        raise malformed("value", f"of type {names}, not {type(value).__name__}")
    return value


def stats_value(counters: dict[str, Any]) -> Message:
    """The value of the reply to `stats`. Robots are in a list, as a map has few keys: a counter
    NAME/ROBOT stands in the map of its robot."""
    value: Message = {}
    robots: dict[str, Message] = {}
    for key, count in counters.items():
        name, slash, robot = key.partition("/")
        if slash:
            robots.setdefault(robot, {"name": robot})[name] = count
        else:
            value[key] = count
    return value | {_ROBOTS: list(robots.values())} if robots else value


def parse_stats(value: Message) -> dict[str, Any]:
    """The counters in the value of a reply. Raises ProtocolError."""
    counters = {name: count for name, count in value.items() if name != _ROBOTS}
    for robot in value.get(_ROBOTS, ()):
        if type(robot) is not dict or type(robot.get("name")) is not str:
            raise ProtocolError("the reply has robots without a name", field=_ROBOTS)
        for name, count in robot.items():
            if name != "name":
                counters[f"{name}/{robot['name']}"] = count
    return counters
