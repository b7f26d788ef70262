"""Joins messages into blocks of many rows, which are committed at once.

The rows of a commit count as simultaneous. So a commit has only static or only dynamic rows, and
ends before a child that changes its parent: else a tree could see a loop that never was.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..ros2.cdr import TfMessage
from .recording import Message

#: Sets of names whose indexes are kept; most publishers send the same frames again and again.
_MAX_SETS: Final = 10_000


class Block(NamedTuple):
    """Rows of successive messages, in order."""

    rows: TfMessage
    static: bool
    messages: int  # how many

    def slice(self, begin: int, end: int) -> Block:
        """Some of its rows."""
        return self._replace(rows=slice_rows(self.rows, begin, end))


def take_rows(rows: TfMessage, which: slice | NDArray[np.intp]) -> TfMessage:
    """Some rows, with all names."""
    names, parent, child, stamp, pose = rows
    return TfMessage(names, parent[which], child[which], stamp[which], pose[which])


def slice_rows(rows: TfMessage, begin: int, end: int) -> TfMessage:
    """Successive rows, with all names."""
    return take_rows(rows, slice(begin, end))


def with_own_names(rows: TfMessage) -> TfMessage:
    """The same rows with only the names that they use, if these are few: to commit or to encode
    rows costs time for every name."""
    if 2 * len(rows.stamp) >= len(rows.names):
        return rows
    used, index = np.unique(np.concatenate([rows.parent, rows.child]), return_inverse=True)
    parent, child = index.astype(np.uint32).reshape(2, -1)
    names = [rows.names[name] for name in used.tolist()]
    return TfMessage(names, parent, child, rows.stamp, rows.pose)


class _Names:
    """Gives each frame one index in all blocks."""

    def __init__(self) -> None:
        self.all: list[str] = []
        self._index: dict[str, int] = {}
        self._of_set: dict[tuple[str, ...], NDArray[np.uint32]] = {}

    def indexes(self, names: list[str]) -> NDArray[np.uint32]:
        """The index in all blocks of each name of a message."""
        key = tuple(names)
        found = self._of_set.get(key)
        if found is None:
            found = np.fromiter(map(self._add, names), np.uint32, len(names))
            if len(self._of_set) < _MAX_SETS:
                self._of_set[key] = found
        return found

    def _add(self, name: str) -> int:
        index = self._index.setdefault(name, len(self.all))
        if index == len(self.all):
            self.all.append(name)
        return index


def join(parts: list[TfMessage], names: _Names | None = None) -> TfMessage:
    """The rows of several messages as one."""
    names = names or _Names()
    indexes = [names.indexes(part.names) for part in parts]
    return TfMessage(
        names.all,
        np.concatenate([index[part.parent] for index, part in zip(indexes, parts, strict=True)]),
        np.concatenate([index[part.child] for index, part in zip(indexes, parts, strict=True)]),
        np.concatenate([part.stamp for part in parts]),
        np.concatenate([part.pose for part in parts]),
    )


def blocks(messages: Iterable[Message], rows: int) -> Iterator[Block]:
    """Join messages until they have this many rows, or static and dynamic ones would mix."""
    names = _Names()
    parts: list[TfMessage] = []
    count, static = 0, False
    for message in messages:
        if parts and (message.static != static or count >= rows):
            yield Block(join(parts, names), static, len(parts))
            parts, count = [], 0
        static = message.static
        parts.append(message.rows)
        count += len(message.rows.stamp)
    if parts:
        yield Block(join(parts, names), static, len(parts))


def commits(block: Block) -> Iterator[Block]:
    """Split a block before each row whose child has another parent than in the row before it."""
    rows = block.rows
    order = np.argsort(rows.child, kind="stable")
    child, parent = rows.child[order], rows.parent[order]
    moved = (child[1:] == child[:-1]) & (parent[1:] != parent[:-1])
    begin = 0
    for row in sorted(order[1:][moved].tolist()):
        yield block.slice(begin, row)
        begin = row
    yield block.slice(begin, len(rows.stamp))
