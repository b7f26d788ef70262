"""Makes the requests for descriptions of the tree and the server. Each function serves the client
method of the same name; `hello` serves the connection itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from zenoh_tf import wire
from zenoh_tf.errors import ProtocolError

from . import columns
from .request import Call, Request

if TYPE_CHECKING:
    from zenoh_tf import AuthorityInfo, ClientInfo, FrameInfo
    from zenoh_tf.introspection.frame_info import FramePart

R = TypeVar("R", "AuthorityInfo", "ClientInfo")

#: A page costs the server a few milliseconds.
_FRAMES_PER_PAGE: Final = 20_000


def _info(
    kind: type | tuple[type, ...], what: str, **arguments: str | int | bytes | None
) -> Request[Any]:
    body = wire.call_body(what, **arguments)
    return Call("info", body, lambda reply: wire.parse_value(reply, kind))


def hello(
    user: str | None = None,
    client: str | None = None,
    clock_ns: int | None = None,
    round_trip: tuple[int, int] | None = None,
) -> Request[dict[str, Any]]:
    """`clock_ns`: this machine's real-time clock. `round_trip`: of the last such request that was
    answered, in nanoseconds, and its `clock_ns`."""
    took_ns, of_ns = round_trip or (None, None)
    clocks = {"clock_ns": clock_ns, "round_trip_ns": took_ns, "round_trip_of_ns": of_ns}
    return _info(dict, "hello", user=user, client=client, **clocks)


def frames() -> Request[list[str]]:
    return _info(list, "frames")


def frames_page(after: int | None) -> Request[tuple[list[str], int | None]]:
    """A page of the frames, and what to ask for next; None if that was the last page. A server
    that knows no pages sends all frames at once."""

    def parse(reply: wire.Message) -> tuple[list[str], int | None]:
        names = wire.parse_value(reply, list)
        following = wire.integer(reply, "next", low=0) if "next" in reply else None
        if following is not None and following <= (after or 0):
            raise ProtocolError("the pages of frames do not advance", field="next")
        return names, following

    return Call("info", wire.call_body("frames", limit=_FRAMES_PER_PAGE, after=after), parse)


def frame(name: str) -> Request[FrameInfo]:
    def parse(reply: wire.Message) -> FrameInfo:
        return _frame_info(wire.parse_value(reply, dict))

    return Call("info", wire.call_body("frame", frame=columns.name(name, "frame")), parse)


def ancestors(target: str, source: str, stamp_ns: int | None) -> Request[list[FrameInfo]]:
    """The frames from both up to their roots, each once, read at one instant. Unknown ones are
    left out. The parents are those at the time where a link has data there."""

    def parse(reply: wire.Message) -> list[FrameInfo]:
        return [_frame_info(record) for record in wire.parse_value(reply, list)]

    stamp = columns.optional_stamp(stamp_ns)
    body = wire.call_body("ancestors", **_pair(target, source), stamp_ns=stamp)
    return Call("info", body, parse)


def _frame_info(value: Any) -> FrameInfo:
    from zenoh_tf.introspection.frame_info import PARTS, FrameInfo  # noqa: PLC0415 - slow

    record = _record(value, FrameInfo)
    for field, kind in PARTS.items():
        if record.get(field) is not None:
            record[field] = _record(record[field], kind)
    return FrameInfo.from_record(record)


def authorities() -> Request[list[AuthorityInfo]]:
    from zenoh_tf import AuthorityInfo  # noqa: PLC0415 - slow

    return _records("authorities", AuthorityInfo)


def clients() -> Request[list[ClientInfo]]:
    from zenoh_tf import ClientInfo  # noqa: PLC0415 - slow

    return _records("clients", ClientInfo)


def _records(what: str, kind: type[R]) -> Request[list[R]]:
    def parse(reply: wire.Message) -> list[R]:
        return [kind(**_record(record, kind)) for record in wire.parse_value(reply, list)]

    return Call("info", wire.call_body(what), parse)


def _record(
    value: Any, kind: type[FrameInfo | FramePart | AuthorityInfo | ClientInfo]
) -> dict[str, Any]:
    """Return the fields of a record that this client knows: a newer server may send more. Fields
    that do not apply are left out, and have their defaults."""
    required = {
        entry.name
        for entry in fields(kind)
        if entry.default is MISSING and entry.default_factory is MISSING
    }
    if type(value) is not dict or not required <= value.keys():
        raise ProtocolError(
            f"the {kind.__name__} in the reply lacks some of the fields {sorted(required)}",
            field="value",
        )
    return {entry.name: value[entry.name] for entry in fields(kind) if entry.name in value}


def parent(frame: str, stamp_ns: int | None = None) -> Request[str | None]:
    name, stamp = columns.name(frame, "frame"), columns.optional_stamp(stamp_ns)
    return _info((str, type(None)), "parent", frame=name, stamp_ns=stamp)


def chain(target: str, source: str, stamp_ns: int | None = None) -> Request[list[str]]:
    return _info(list, "chain", **_pair(target, source), stamp_ns=columns.optional_stamp(stamp_ns))


def _pair(target: str, source: str) -> dict[str, str]:
    return {
        "target": columns.name(target, "target_frame"),
        "source": columns.name(source, "source_frame"),
    }


def stats() -> Request[dict[str, int]]:
    body = wire.call_body("stats")
    return Call("info", body, lambda reply: wire.parse_stats(wire.parse_value(reply, dict)))


def cancel(wait_ids: Sequence[int]) -> Request[list[int]]:
    """End lookups that wait at the server. The result: those that do not wait (yet)."""

    def parse(reply: wire.Message) -> list[int]:
        missed: list[int] = wire.parse_value(reply, list)
        if not all(type(wait_id) is int for wait_id in missed):
            raise ProtocolError("the reply to a cancellation is malformed", field="value")
        return missed

    column = wire.raw(np.array(wait_ids), wire.I64)
    return Call("info", wire.call_body("cancel", wait_ids=column), parse)
