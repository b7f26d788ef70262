"""Commit messages: one write transaction as columns (docs/reference/protocol.md, "commit").

A put of transforms carries the same body, but its key gives `authority` and `static`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import TransformRows, Tree
from ..errors import ProtocolError, must_be_str
from .error_codec import raise_error
from .fields import (
    F64,
    I64,
    U64,
    Message,
    column,
    flag,
    indexes,
    integer,
    malformed,
    raw,
    text,
    texts,
)

ID_BYTES: Final = 16


@dataclass(slots=True)
class Write:
    """Request id, expiry and target instance: with them a write runs at most once."""

    id: bytes | None = None  # 16 bytes; a repeat has the same
    expires_ns: int | None = None  # on the server's clock, see "hello"
    instance: str | None = None  # any other server instance refuses the write


def write_fields(identity: bytes, expires_ns: int, instance: str) -> Message:
    """The fields that `parse_write` reads."""
    return {"id": identity, "expires_ns": expires_ns, "instance": instance}


def parse_write(message: Message) -> Write:
    get = message.get
    identity, expires_ns, instance = get("id"), get("expires_ns"), get("instance")
    if (
        type(identity) is bytes
        and len(identity) == ID_BYTES
        and type(expires_ns) is int
        and 0 <= expires_ns < 1 << 63
        and type(instance) is str
    ):  # the common case
        return Write(identity, expires_ns, instance)
    write = Write()
    if "id" in message:
        identity = message["id"]
        if type(identity) is not bytes or len(identity) != ID_BYTES:
            raise malformed("id", f"{ID_BYTES} bytes")
        write.id = identity
    if "expires_ns" in message:
        write.expires_ns = integer(message, "expires_ns")
    if "instance" in message:
        write.instance = text(message, "instance")
    return write


@dataclass(slots=True)
class Commit:
    """The rows of one write, at one instant. A query stores all of them or none, a put those that
    are good."""

    rows: TransformRows
    authority: str = ""
    static: bool = False
    drop_old: bool = False  # drop rows that are too old; else they fail the commit
    announce: bool = False  # static: store only what nobody has changed or removed since
    read_names: Sequence[str] = ()
    read_versions: NDArray[np.uint64] | None = None  # if one has changed: TransactionConflict
    expires_ns: int | None = None  # on the server's clock; it is not sent here but with `Write`
    max_stamp_ns: int | None = None  # of a put, not sent: later dynamic rows are dropped
    drop_bad: bool = False  # of a put, not sent: refuse bad rows alone; else they fail the commit
    drop_strays: bool = False  # of a put, not sent: refuse dynamic rows of another clock

    def apply(self, tree: Tree) -> bytes:
        """Commit it to a tree. Returns what became of each row (zenoh_tf.admission)."""
        return tree._commit_rows(
            self.rows,
            authority=self.authority,
            static=self.static,
            drop_old=self.drop_old,
            drop_bad=self.drop_bad,
            read_names=self.read_names,
            read_versions=self.read_versions,
            expires_ns=self.expires_ns,
        )


def commit_body(commit: Commit) -> Message:
    """The body of a commit. Fields with default values are left out."""
    if not isinstance(commit.authority, str):
        raise must_be_str("authority", commit.authority)
    parent, child, stamp, pose = commit.rows.columns()
    body: Message = {
        "v": 1,
        "names": commit.rows.names,
        "parent": parent,
        "child": child,
        "stamp": stamp,
        "pose": pose,
    }
    if commit.authority:
        body["authority"] = commit.authority
    if commit.static:
        body["static"] = True
    if commit.drop_old:
        body["drop_old"] = True
    if commit.announce:
        body["announce"] = True
    if commit.read_versions is not None:
        body["read_names"] = commit.read_names
        body["read_versions"] = raw(commit.read_versions, U64)
    return body


def parse_commit(body: Message) -> Commit:
    get = body.get
    rows = TransformRows.parse(get("names"), get("parent"), get("child"), get("stamp"), get("pose"))
    if rows is None:
        raise _malformed_rows(body)
    commit = Commit(rows)
    if "authority" in body:
        commit.authority = text(body, "authority")
    if "static" in body:
        commit.static = flag(body, "static")
    if "drop_old" in body:
        commit.drop_old = flag(body, "drop_old")
    if "announce" in body:
        commit.announce = flag(body, "announce")
    if "read_names" in body or "read_versions" in body:
        commit.read_names = texts(body, "read_names")
        commit.read_versions = column(body, "read_versions", U64, len(commit.read_names))
    return commit


def commit_parts(rows: TransformRows) -> Iterator[TransformRows]:
    """Split rows before each one whose child has another parent than in the row before it.

    The rows of a commit count as simultaneous: else a tree could see a loop that never was.
    """
    order = np.argsort(rows.child, kind="stable")
    child, parent = rows.child[order], rows.parent[order]
    moved = (child[1:] == child[:-1]) & (parent[1:] != parent[:-1])
    begin = 0
    for row in sorted(order[1:][moved].tolist()):
        yield rows[begin:row]
        begin = row
    yield rows[begin:] if begin else rows


def _malformed_rows(body: Message) -> ProtocolError:
    """What is wrong with the rows of a body, for which `TransformRows.parse` gave None."""
    names = texts(body, "names")
    rows = column(body, "stamp", I64).size
    indexes(body, "parent", rows, len(names))
    indexes(body, "child", rows, len(names))
    column(body, "pose", F64, rows, 7)
    return malformed("names", "names of frames")


def parse_commit_reply(reply: Message, rows: int) -> bytes:
    """A byte for each row: 1 stored, 0 dropped as too old. Raises the error that `reply` carries,
    if any."""
    if "error" in reply:
        raise_error(reply)
    stored = reply.get("stored")
    if type(stored) is not bytes or len(stored) != rows:
        raise malformed("stored", f"binary, of {rows} bytes")
    return stored
