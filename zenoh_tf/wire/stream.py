"""Messages of the commit stream, snapshots and missed messages (docs/reference/protocol.md,
"stream").

What has changed, and frames with their histories, are bytes here, which the native `ChangeReplay`
reads; `samples` has their samples as columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .error_codec import raise_error
from .fields import (
    MAX_REPLY_BYTES,
    U32,
    VERSION,
    Message,
    binary,
    column,
    fields_of,
    flag,
    integer,
    items,
    malformed,
    mapping,
    raw,
    text,
    unpack,
)
from .interest import Interest
from .tree_settings import TreeSettings, parse_tree_settings

#: Ids of frames have 32 bits.
_MAX_ID: Final = (1 << 32) - 1
#: What one message may take when it is decoded. Those of a server take a tenth of it.
_DECODED_BYTES: Final = 128 << 20
#: Of a plan without pieces.
NO_BOUNDS: Final = np.zeros(0, np.uint32)


@dataclass(slots=True)
class StreamMessage:
    """All that the commits from `first` to `last` have changed. A heartbeat has no changes."""

    instance: str
    first: int  # one more than the `last` of the message before
    last: int
    clock_ns: int  # the server's clock when the message was made
    changes: bytes | None = None
    real_ns: int | None = None  # its real-time clock at that time; None if it does not say


def stream_body(message: StreamMessage) -> Message:
    """The map of a stream message."""
    return {"v": VERSION} | fields_of(message)


def unpack_stream(data: bytes) -> StreamMessage:
    """A message of the stream. Raises ProtocolError and LimitExceeded."""
    return parse_stream(unpack(data, MAX_REPLY_BYTES, _DECODED_BYTES))


def parse_stream(body: Message) -> StreamMessage:
    """A stream message. Raises ProtocolError."""
    message = StreamMessage(
        text(body, "instance"),
        integer(body, "first", low=1),
        integer(body, "last", low=0),
        integer(body, "clock_ns"),
        binary(body, "changes") if "changes" in body else None,
        integer(body, "real_ns") if "real_ns" in body else None,
    )
    if message.last < message.first - 1:
        raise malformed("last", "at least first - 1")
    return message


# --- snapshot


@dataclass(slots=True)
class SnapshotPlan:
    """How a snapshot is pulled: piece i has the ids above bounds[i], up to bounds[i + 1]."""

    seq: int  # the stream's changes after this one belong on top of the snapshot
    ever_reparented: bool
    bounds: NDArray[np.uint32]
    settings: TreeSettings
    clock_ns: int
    changes: bytes | None = None  # of an interest: all that there is, and no pieces


def snapshot_plan_reply(plan: SnapshotPlan) -> Message:
    """The reply to a `snapshot` request without a piece, without the envelope."""
    return ({} if plan.changes is None else {"changes": plan.changes}) | {
        "seq": plan.seq,
        "reparented": plan.ever_reparented,
        "bounds": raw(plan.bounds, U32),
        "settings": plan.settings.fields(),
        "clock_ns": plan.clock_ns,
    }


def parse_snapshot_plan(reply: Message) -> SnapshotPlan:
    """The plan in a reply. Raises the error that it carries, or ProtocolError."""
    raise_error(reply)
    bounds = column(reply, "bounds", U32)
    changes = binary(reply, "changes") if "changes" in reply else None
    if (changes is None and bounds.size < 2) or bool(np.any(bounds[:-1] > bounds[1:])):
        raise malformed("bounds", "two or more ascending ids")
    return SnapshotPlan(
        integer(reply, "seq", low=0),
        flag(reply, "reparented"),
        bounds,
        parse_tree_settings(mapping(reply, "settings")),
        integer(reply, "clock_ns"),
        changes,
    )


@dataclass(slots=True)
class SnapshotRequest:
    """A request for the frames with ids above `after`, up to `until`."""

    instance: str
    piece: int  # the number of the piece, which the reply repeats
    after: int
    until: int


def snapshot_request(request: SnapshotRequest | None, interest: Interest | None = None) -> Message:
    """The body of a request for a piece, or with None for the plan, or all of an interest."""
    if request is None:
        body: Message = {"v": VERSION}
        return body if interest is None else body | {"interest": interest.fields()}
    return {"v": VERSION} | fields_of(request)


def parse_snapshot_request(body: Message) -> SnapshotRequest | None:
    """The piece that is requested; None: the plan. Raises ProtocolError."""
    if "piece" not in body:
        return None
    ids = [integer(body, name, low=0) for name in ("after", "until")]
    for name, value in zip(("after", "until"), ids, strict=True):
        if value > _MAX_ID:
            raise malformed(name, "an id of 32 bits")
    return SnapshotRequest(text(body, "instance"), integer(body, "piece", low=0), *ids)


@dataclass(slots=True)
class SnapshotPiece:
    """Some frames, with all that is known of them."""

    piece: int
    reached: int  # the last id that was read; below `until` if the piece was cut short
    last: int  # a number that the mirror must reach before it may be read
    frames: bytes


def snapshot_piece_reply(piece: SnapshotPiece) -> Message:
    """The reply with a piece, without the envelope."""
    return fields_of(piece)


def parse_snapshot_piece(reply: Message) -> SnapshotPiece:
    """The piece in a reply. Raises the error that it carries, or ProtocolError."""
    raise_error(reply)
    return SnapshotPiece(
        integer(reply, "piece", low=0),
        integer(reply, "reached", low=0),
        integer(reply, "last", low=0),
        binary(reply, "frames"),
    )


# --- missed


def missed_request(instance: str, first: int, interest: Interest | None = None) -> Message:
    """The body of a request for the stream's messages from the number `first` on."""
    body = {"v": VERSION, "instance": instance, "first": first}
    return body if interest is None else body | {"interest": interest.id}


def parse_missed_request(body: Message) -> tuple[str, int, str]:
    """The instance, the first number and the id of the interest, or "". Raises ProtocolError."""
    return text(body, "instance"), integer(body, "first", low=1), text(body, "interest", "")


def missed_reply(messages: list[bytes], last: int) -> Message:
    """The reply to it: as many messages as there is room for, or none if they are forgotten."""
    return {"messages": messages, "last": last}


def parse_missed_reply(reply: Message) -> tuple[list[bytes], int]:
    """The messages, to be unpacked as those of the stream, and the last number of the stream.

    Raises the error that the reply carries, or ProtocolError.
    """
    raise_error(reply)
    messages: list[Any] = items(reply, "messages")
    if not all(type(message) is bytes for message in messages):
        raise malformed("messages", "a list of binaries")
    return messages, integer(reply, "last", low=0)
