"""Blocks of many rows, which are committed at once.

The rows of a commit count as simultaneous. So a commit has only static or only dynamic rows, and
ends before a child that changes its parent: else a tree could see a loop that never was.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..ros2.cdr import TfMessage


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


def join(parts: Sequence[TfMessage]) -> TfMessage:
    """The rows of several messages, at least one, as one."""
    index: dict[str, int] = {}
    in_all = [
        np.fromiter((index.setdefault(name, len(index)) for name in part.names), np.uint32)
        for part in parts
    ]
    return TfMessage(
        [*index],
        np.concatenate([at[part.parent] for at, part in zip(in_all, parts, strict=True)]),
        np.concatenate([at[part.child] for at, part in zip(in_all, parts, strict=True)]),
        np.concatenate([part.stamp for part in parts]),
        np.concatenate([part.pose for part in parts]),
    )


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
