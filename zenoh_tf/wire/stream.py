"""Messages of the commit stream, snapshots and missed messages (docs/reference/protocol.md,
"stream").

The columns of changes and frames are `zenoh_tf._core.Changes` and `Frames`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._core import Changes, Frames, TransformRows
from .error_codec import raise_error
from .fields import (
    MAX_REPLY_BYTES,
    U32,
    VERSION,
    Message,
    column,
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

#: Kinds of changes, as in records/change_log.hpp. The first two have a sample.
SAMPLE: Final = 0
STATIC: Final = 1
CREATED: Final = 2
CLEARED: Final = 3
REMOVED: Final = 4
NEW_VERSION: Final = 5
ORPHANED: Final = 6

#: The parent of a sample whose parent was removed, and of an orphaned frame that lost none.
NO_PARENT: Final = (1 << 32) - 1

#: What one message may take when it is decoded. Those of a server take a tenth of it.
_DECODED_BYTES: Final = 128 << 20
#: Of a plan without pieces.
NO_BOUNDS: Final = np.zeros(0, np.uint32)


class Samples(NamedTuple):
    """The samples of changes or frames as columns, a row for each."""

    names: list[str]
    authorities: list[str]
    parent: NDArray[np.uint32]  # (n,) indexes into names, or NO_PARENT
    child: NDArray[np.uint32]  # (n,)
    stamp: NDArray[np.int64]  # (n,) ns
    pose: NDArray[np.float64]  # (n, 7)
    authority: NDArray[np.uint32]  # (n,) indexes into authorities
    static: NDArray[np.bool_]  # (n,)

    @property
    def has_parent(self) -> NDArray[np.bool_]:
        """(n,) False if the parent was removed."""
        return np.not_equal(self.parent, NO_PARENT)

    def rows(self, chosen: NDArray[np.intp]) -> TransformRows:
        """Some of them, each with a parent, by their numbers."""
        parent, child = self.parent[chosen], self.child[chosen]
        return TransformRows(self.names, parent, child, self.stamp[chosen], self.pose[chosen])


def samples_of_changes(changes: Changes) -> Samples:
    has_sample = changes.kind <= STATIC
    return Samples(
        list(changes.names),
        list(changes.authorities),
        changes.parent,
        changes.frame[has_sample],
        changes.stamp,
        changes.pose,
        changes.authority,
        changes.kind[has_sample] == STATIC,
    )


def samples_of_frames(frames: Frames) -> Samples:
    return Samples(
        list(frames.names),
        list(frames.authorities),
        frames.parent,
        np.repeat(frames.frame, frames.count),
        frames.stamp,
        frames.pose,
        np.repeat(frames.authority, frames.count),
        np.repeat(frames.static != 0, frames.count),
    )


@dataclass(slots=True)
class StreamMessage:
    """All that the commits from `first` to `last` have changed. A heartbeat has no changes."""

    instance: str
    first: int  # one more than the `last` of the message before
    last: int
    clock_ns: int  # the server's clock when the message was made
    changes: Changes | None = None
    real_ns: int | None = None  # its real-time clock at that time; None if it does not say


def stream_body(message: StreamMessage) -> Message:
    """The map of a stream message."""
    body: Message = {
        "v": VERSION,
        "instance": message.instance,
        "first": message.first,
        "last": message.last,
        "clock_ns": message.clock_ns,
    }
    if message.real_ns is not None:
        body["real_ns"] = message.real_ns
    if message.changes is not None:
        body |= message.changes.fields()
    return body


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
        real_ns=integer(body, "real_ns") if "real_ns" in body else None,
    )
    if message.last < message.first - 1:
        raise malformed("last", "at least first - 1")
    if "kind" in body:
        message.changes = Changes(body)
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
    changes: Changes | None = None  # of an interest: all that there is, and no pieces


def snapshot_plan_reply(plan: SnapshotPlan) -> Message:
    """The reply to a `snapshot` request without a piece, without the envelope."""
    return ({} if plan.changes is None else plan.changes.fields()) | {
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
    changes = Changes(reply) if "kind" in reply else None
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
    return {
        "v": VERSION,
        "instance": request.instance,
        "piece": request.piece,
        "after": request.after,
        "until": request.until,
    }


def parse_snapshot_request(body: Message) -> SnapshotRequest | None:
    """The piece that is requested; None: the plan. Raises ProtocolError."""
    if "piece" not in body:
        return None
    ids = [integer(body, name, low=0) for name in ("after", "until")]
    for name, value in zip(("after", "until"), ids, strict=True):
        if value > NO_PARENT:
            raise malformed(name, "an id of 32 bits")
    return SnapshotRequest(text(body, "instance"), integer(body, "piece", low=0), *ids)


@dataclass(slots=True)
class SnapshotPiece:
    """Some frames, with all that is known of them."""

    piece: int
    reached: int  # the last id that was read; below `until` if the piece was cut short
    last: int  # a number that the mirror must reach before it may be read
    frames: Frames


def snapshot_piece_reply(piece: SnapshotPiece) -> Message:
    """The reply with a piece, without the envelope."""
    body: Message = {"piece": piece.piece, "reached": piece.reached, "last": piece.last}
    return body | piece.frames.fields()


def parse_snapshot_piece(reply: Message) -> SnapshotPiece:
    """The piece in a reply. Raises the error that it carries, or ProtocolError."""
    raise_error(reply)
    return SnapshotPiece(
        integer(reply, "piece", low=0),
        integer(reply, "reached", low=0),
        integer(reply, "last", low=0),
        Frames(reply),
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
