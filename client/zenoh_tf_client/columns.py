"""Arguments of the API as columns of the wire: each name is sent once."""

from __future__ import annotations

from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import StampedTransform, _core, wire
from zenoh_tf.errors import InvalidArgumentException

#: target, source, OP_..., stamp_ns or NO_STAMP
Row = tuple[str, str, int, int]


class _Names(dict[str, int]):
    """Name -> row of the message's names; a name not seen before gets the next row."""

    def __missing__(self, name: str) -> int:
        row = self[name] = len(self)
        return row

    def column(self, names: str | Sequence[str], count: int) -> NDArray[np.uint32]:
        if isinstance(names, str):
            return np.full(count, self[names], np.uint32)
        return np.fromiter(map(self.__getitem__, names), np.uint32, count)


def at(target: str, source: str, stamp_ns: int | None) -> Row:
    """A lookup at a time, or at the latest common time."""
    if stamp_ns is None:
        return target, source, wire.OP_COMMON, wire.NO_STAMP
    try:
        stamp = index(stamp_ns)
    except TypeError:
        stamp = wire.NO_STAMP
    if not wire.NO_STAMP < stamp < -wire.NO_STAMP:  # the lowest would be read as no time at all
        raise InvalidArgumentException(
            f"stamp_ns must be an integer of 64 bits, not {stamp_ns!r}", field="stamp_ns"
        )
    return target, source, wire.OP_AT, stamp


def stamps(stamps_ns: ArrayLike | None, count: int) -> NDArray[np.int64]:
    """(count,) ns; one time stands for every row, None for no time."""
    if stamps_ns is None:
        return np.full(count, wire.NO_STAMP, np.int64)
    values = np.asarray(stamps_ns)
    if values.size and values.dtype.kind not in "iu":
        raise InvalidArgumentException(
            f"stamps_ns must be integers, not {values.dtype}", field="stamps_ns"
        )
    return np.broadcast_to(values.astype(np.int64, copy=False), (count,))


def rows(
    targets: str | Sequence[str], sources: str | Sequence[str], stamps_ns: ArrayLike | None
) -> int:
    """The number of rows that the arguments agree on; single values stand for every row."""
    sizes = {
        "targets": None if isinstance(targets, str) else len(targets),
        "sources": None if isinstance(sources, str) else len(sources),
        "stamps_ns": None if stamps_ns is None or np.ndim(stamps_ns) == 0 else np.size(stamps_ns),
    }
    given = {size for size in sizes.values() if size is not None}
    if len(given) > 1:
        raise InvalidArgumentException(f"unequal numbers of rows: {sizes}", field="targets")
    return given.pop() if given else 1


def lookup(
    targets: str | Sequence[str],
    sources: str | Sequence[str],
    stamps_ns: ArrayLike | None,
    op: int,
    count: int,
) -> wire.Lookup:
    """`count` reads of one kind."""
    names = _Names()
    target = names.column(targets, count)
    source = names.column(sources, count)
    stamp = stamps(stamps_ns, count)
    return wire.Lookup(list(names), np.full(count, op, np.uint8), target, source, stamp)


def join(rows: Sequence[Row]) -> wire.Lookup:
    """Any single reads as one lookup, in order."""
    names = _Names()
    count = len(rows)
    targets, sources, ops, times = zip(*rows, strict=True) if rows else ((), (), (), ())
    return wire.Lookup(
        target=names.column(targets, count),
        source=names.column(sources, count),
        op=np.fromiter(ops, np.uint8, count),
        stamp=np.fromiter(times, np.int64, count),
        names=list(names),
    )


def commit(
    stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
) -> wire.Commit:
    """The rows of a transaction."""
    return wire.Commit(*_core.columns_of(stampeds), authority, static)
