"""Turns arguments of the API into the columns of a message, which sends each name once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import index
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_tf import StampedTransform, _core, wire
from zenoh_tf.errors import InvalidArgumentException, must_be, must_be_str

#: The largest stamp; the smallest is NO_STAMP + 1.
_MAX_STAMP = -wire.NO_STAMP - 1

#: (target, source, OP_..., stamp_ns or NO_STAMP) of a single lookup.
Row = tuple[str, str, int, int]


def at(target: str, source: str, stamp_ns: int | None) -> Row:
    """Return the row of a lookup at a time, or at the latest common time for None."""
    if stamp_ns is None:
        return target, source, wire.OP_COMMON, wire.NO_STAMP
    return target, source, wire.OP_AT, stamp(stamp_ns)


def name(value: str, field: str) -> str:
    """Return the name of a frame. Raises WrongType, which names `field`, if it is no str."""
    if not isinstance(value, str):
        raise must_be_str(field, value)
    return value


def stamp(stamp_ns: int | None, field: str = "stamp_ns") -> int:
    """Return one stamp in ns; None becomes NO_STAMP.

    Raises InvalidArgumentException, which names `field`, for the stamps that `stamps` rejects.
    """
    if stamp_ns is None:
        return wire.NO_STAMP
    try:
        value = index(stamp_ns)
    except TypeError:
        value = wire.NO_STAMP
    if not wire.NO_STAMP < value <= _MAX_STAMP:
        raise InvalidArgumentException(
            f"{field} must be an integer from -2^63 + 1 to 2^63 - 1, not {stamp_ns!r}", field=field
        )
    return value


def optional_stamp(stamp_ns: int | None) -> int | None:
    """Check a stamp as `stamp` does; None stays None."""
    return None if stamp_ns is None else stamp(stamp_ns)


def stamps(stamps_ns: ArrayLike | None, count: int) -> NDArray[np.int64]:
    """Return (count,) stamps in ns; one stamp is repeated, None becomes NO_STAMP.

    Raises InvalidArgumentException for a stamp outside of int64, and for NO_STAMP itself, which
    would read as "no time given".
    """
    if stamps_ns is None:
        return np.full(count, wire.NO_STAMP, np.int64)
    try:
        values = np.asarray(stamps_ns)
    except OverflowError as error:
        raise _invalid_stamps(str(error)) from error
    if values.ndim > 1:
        raise _invalid_stamps(f"one for each row, not of shape {values.shape}")
    if values.size and values.dtype.kind not in "iu":
        raise _invalid_stamps(_reason(values))
    if values.size:
        lowest, highest = int(values.min()), int(values.max())
        if lowest <= wire.NO_STAMP or highest > _MAX_STAMP:
            raise _invalid_stamps(f"not {highest if highest > _MAX_STAMP else lowest}")
    return np.broadcast_to(values.astype(np.int64, copy=False), (count,))


def _reason(values: NDArray[Any]) -> str:
    """Say which of the values is no 64-bit integer; integers beyond 64 bits are objects."""
    if values.dtype.kind == "O":
        for value in values.flat:
            if not isinstance(value, int) or not wire.NO_STAMP < value <= _MAX_STAMP:
                return f"not {value!r}"
    return f"not {values.dtype}"


def _invalid_stamps(reason: str) -> InvalidArgumentException:
    return InvalidArgumentException(
        f"stamps_ns must be integers from -2^63 + 1 to 2^63 - 1, {reason}", field="stamps_ns"
    )


def rows(
    targets: str | Sequence[str], sources: str | Sequence[str], stamps_ns: ArrayLike | None
) -> int:
    """Return the number of rows; a single value stands for every row.

    Raises InvalidArgumentException if the lengths of the others differ.
    """
    sizes = {
        "targets": None if isinstance(targets, str) else len(targets),
        "sources": None if isinstance(sources, str) else len(sources),
        "stamps_ns": None if stamps_ns is None or np.ndim(stamps_ns) == 0 else np.size(stamps_ns),
    }
    given = {size for size in sizes.values() if size is not None}
    if len(given) > 1:
        raise InvalidArgumentException(f"the numbers of rows differ: {sizes}", field="targets")
    return given.pop() if given else 1


def lookup(
    targets: str | Sequence[str],
    sources: str | Sequence[str],
    stamps_ns: ArrayLike | None,
    op: int,
    count: int,
) -> wire.Lookup:
    """Return `count` lookups of one kind."""
    names, target, source = _core.columns_of_pairs(targets, sources, count)
    stamp = stamps(stamps_ns, count)
    return wire.Lookup(names, np.full(count, op, np.uint8), target, source, stamp)


def join(rows: Sequence[Row]) -> wire.Lookup:
    """Return single lookups of any kind as one message, in order."""
    count = len(rows)
    targets, sources, ops, times = zip(*rows, strict=True) if rows else ((), (), (), ())
    names, target, source = _core.columns_of_pairs(targets, sources, count)
    op = np.fromiter(ops, np.uint8, count)
    return wire.Lookup(names, op, target, source, np.fromiter(times, np.int64, count))


def commit(
    stampeds: Sequence[StampedTransform], authority: str = "", static: bool = False
) -> wire.Commit:
    """Return transforms as the columns of a commit."""
    return wire.Commit(transform_rows(stampeds), authority, static)


def transform_rows(stampeds: Iterable[StampedTransform]) -> _core.TransformRows:
    """Return transforms as rows. Raises InvalidArgumentException if they are anything else."""
    try:
        return _core.TransformRows.of(stampeds)
    except (TypeError, InvalidArgumentException) as error:
        raise must_be("stampeds", "a sequence of StampedTransforms", stampeds) from error
