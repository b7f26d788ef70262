"""Commit messages: one write transaction as columns (docs/protocol.md, "commit").

A put of transforms carries the same body, but its key gives `authority` and `static`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .error_codec import raise_error
from .fields import (
    F64,
    I64,
    U8,
    U32,
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
    """One write transaction, with a row per transform: all rows are stored or none."""

    names: list[str]
    parent: NDArray[np.uint32]  # (n,) indexes into names
    child: NDArray[np.uint32]  # (n,)
    stamp: NDArray[np.int64]  # (n,) ns
    pose: NDArray[np.float64]  # (n, 7) x y z qx qy qz qw of child in parent
    authority: str = ""
    static: bool = False
    drop_old: bool = False  # drop rows that are too old; else they fail the commit
    announce: bool = False  # static: store only what nobody has changed or removed since
    read_names: list[str] = field(default_factory=list)
    read_versions: NDArray[np.uint64] | None = None  # if one has changed: TransactionConflict
    expires_ns: int | None = None  # on the server's clock; it is not sent here but with `Write`

    @property
    def rows(self) -> int:
        return len(self.stamp)


def commit_body(commit: Commit, write: Mapping[str, object] | None = None) -> Message:
    """The body of a commit. Fields with default values are left out."""
    body: Message = {
        "v": 1,
        "names": commit.names,
        "parent": raw(commit.parent, U32),
        "child": raw(commit.child, U32),
        "stamp": raw(commit.stamp, I64),
        "pose": raw(commit.pose, F64),
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
    if write:
        body.update(write)
    return body


def parse_commit(body: Message) -> Commit:
    names = texts(body, "names")
    stamp = column(body, "stamp", I64)
    rows = stamp.size
    commit = Commit(
        names,
        indexes(body, "parent", rows, len(names)),
        indexes(body, "child", rows, len(names)),
        stamp,
        column(body, "pose", F64, rows, 7).reshape(rows, 7),
        text(body, "authority", ""),
        flag(body, "static"),
        flag(body, "drop_old"),
        flag(body, "announce"),
    )
    if "read_names" in body or "read_versions" in body:
        commit.read_names = texts(body, "read_names")
        commit.read_versions = column(body, "read_versions", U64, len(commit.read_names))
    return commit


def commit_reply(stored: NDArray[np.uint8]) -> Message:
    """The reply to a commit, without the envelope's "v" and "instance"."""
    return {"stored": raw(stored, U8)}


def parse_commit_reply(reply: Message, rows: int) -> NDArray[np.uint8]:
    """(n,): 1 stored, 0 dropped as too old. Raises the error that `reply` carries, if any."""
    raise_error(reply)
    return column(reply, "stored", U8, rows)
