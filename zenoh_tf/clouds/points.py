"""Arrays of points and of their stamps, as the native kernels read them.

Internal: for the trees and the client, which deskew sweeps, and for `TransformArray`.

Thread safety: all functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from zenoh_tf import _core
from zenoh_tf.clouds import sweep_times
from zenoh_tf.errors import (
    BY_CODE,
    ExtrapolationException,
    InvalidArgumentException,
    TransformException,
    must_be,
)
from zenoh_tf.gap_limit import NO_GAPS, max_gap_ns

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from zenoh_tf._core import AskServer, SharedTree, Tree

    Points = NDArray[Any]  # float32 or float64

#: The codes of errors that are about a point's time, so that other points may have an answer.
_OF_A_TIME: Final = [
    kind.code for kind in BY_CODE.values() if issubclass(kind, ExtrapolationException)
]

_KINDS = (np.dtype(np.float32), np.dtype(np.float64))


def real_numbers(points: ArrayLike) -> Points:
    """The points as float32 or float64, which native code can read. Copies only where it must."""
    try:
        values = np.asarray(points)
    except ValueError:
        values = np.empty((), object)
    if values.dtype in _KINDS and values.dtype.isnative:
        return readable(values)
    if not np.can_cast(values.dtype, np.float64, "same_kind"):
        raise InvalidArgumentException("points must be an array of real numbers", field="points")
    kind = np.float32 if values.dtype == np.dtype(np.float32).newbyteorder() else np.float64
    return values.astype(kind)


def readable(values: Points) -> Points:
    """The array, or a copy if it lies in records whose size is no multiple of a number's."""
    odd = any(stride % values.itemsize for stride in values.strides)
    return np.ascontiguousarray(values) if odd else values


def output_like(points: Points, out: Points | None, kind: Any) -> Points:
    """The array to write to: `out`, or a new one of the points' shape and this type."""
    if out is None:
        return np.empty(points.shape, kind)
    if (
        not isinstance(out, np.ndarray)
        or out.shape != points.shape
        or out.dtype not in _KINDS
        or not out.dtype.isnative
        or not out.flags.writeable
    ):
        raise InvalidArgumentException(
            f"out must be a writable float32 or float64 array of the shape {points.shape}",
            field="out",
        )
    return out


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """The keyword arguments of `TransformTree.deskew`, which documents them."""

    out: Points | None = None
    begin_ns: int | None = None
    max_gap_s: float | None = None
    missing: Literal["nan", "raw"] = "nan"
    ok: NDArray[np.bool_] | None = None
    strict: bool = False


class Sweep:
    """The points of a sweep with the time of each, and the arrays for the result.

    Raises:
        InvalidArgumentException: The arrays do not fit each other, or hold other values.
    """

    def __init__(
        self, points: ArrayLike, stamps_ns: ArrayLike, at_ns: int, options: SweepOptions
    ) -> None:
        values = real_numbers(points)
        if not 1 <= values.ndim <= 3 or values.shape[-1] != 3:
            raise InvalidArgumentException(
                f"points must have the shape (n, 3) or (rows, columns, 3), not {values.shape}",
                field="points",
            )
        if options.missing not in ("nan", "raw"):
            raise must_be("missing", "'nan' or 'raw'", options.missing)
        #: What the caller gets.
        self.out = output_like(values, options.out, values.dtype)
        self.at_ns = _integer(at_ns, "at_ns")
        self.max_gap_ns = max_gap_ns(options.max_gap_s, NO_GAPS)
        self.strict = options.strict
        self._missing = options.missing
        grid = values.shape[:-1]
        self._ok = _mask(options.ok, grid)
        shape = (1,) * (2 - len(grid)) + grid
        #: Of the shapes (rows, columns, 3) and (rows, columns).
        self.points = values.reshape((*shape, 3)) if values.ndim < 3 else values
        stamps, self._lost = _stamps(stamps_ns, grid), None
        if options.begin_ns is not None:
            begin_ns = _integer(options.begin_ns, "begin_ns")
            narrow = np.asarray(stamps_ns).dtype == np.uint32
            stamps, lost = sweep_times.absolute(stamps, begin_ns, narrow=narrow)
            if lost is not None:
                stamps = np.where(lost, self.at_ns, stamps)
                self._lost = lost.reshape(shape)
        self.stamps = stamps.reshape(shape)
        written = self.out if self.out.ndim == 3 else self.out.reshape((*shape, 3))
        # Native code cannot write to odd addresses.
        self._written = written
        self.target = readable(written)

    def done(self) -> Points:
        """The result, once it is in `target`, and every point that has a stamp was moved."""
        if self._lost is None:
            return self._finish(None, None)
        return self._finish(self._lost, self.points[self._lost])

    def times(self) -> NDArray[np.int64]:
        """Every time at which the motion is needed, once, ascending; `at_ns` too."""
        return np.unique(np.append(np.unique(self.stamps), self.at_ns))

    def compensate(
        self,
        times: NDArray[np.int64],
        status: NDArray[np.uint8],
        poses: NDArray[np.float64],
        error_of: Callable[[int], TransformException],
    ) -> Points:
        """Return the result from `X_fixed_source` at each of `times`: NaN where `status`, an
        error's code, is not 0. `error_of` gives the error of such a row.

        Raises the error at `at_ns`; the first one if no point can be moved, one is not about a
        time, or errors are strict.
        """
        at_row = int(np.searchsorted(times, self.at_ns))
        if status[at_row]:
            raise error_of(at_row)
        failed = np.flatnonzero(status)
        rows = np.searchsorted(times, self.stamps) if failed.size else None
        bad = None if rows is None else status[rows] != 0
        if failed.size and (
            self.strict or bad is None or bad.all() or not np.isin(status[failed], _OF_A_TIME).all()
        ):
            raise error_of(int(failed[0]))
        if self._lost is not None:
            bad = self._lost if bad is None else bad | self._lost
        kept = None if bad is None else self.points[bad]  # `out` may be `points`
        at = poses[at_row].tolist()
        _core.deskew_by_samples(self.points, self.stamps, self.target, times, poses, at)
        return self._finish(bad, kept)

    def _finish(self, bad: NDArray[np.bool_] | None, kept: Points | None) -> Points:
        """The result, with NaN or what was measured for points that could not be moved."""
        if bad is not None:
            self.target[bad] = np.nan if self._missing == "nan" else kept
        if self._ok is not None:
            self._ok[...] = True if bad is None else ~bad.reshape(self._ok.shape)
        if self.target is not self._written:
            self._written[...] = self.target
        return self.out


def deskew(tree: Tree | SharedTree, sweep: Sweep, source: str, fixed: str) -> Points | AskServer:
    """Move a sweep's points by a tree of this process; a mapped one may return an AskServer."""
    try:
        done = tree._deskew(
            *(sweep.points, sweep.stamps, sweep.target, source, fixed, sweep.at_ns),
            sweep.max_gap_ns,
        )
    except ExtrapolationException as error:
        if sweep.strict or error.stamp_ns == sweep.at_ns:
            raise
        done = False
    if isinstance(done, _core.AskServer):
        return done
    if done:
        return sweep.done()
    # Each time by itself: the path may differ from time to time, or some have no answer.
    times = sweep.times()
    rows = tree._read_rows(
        [fixed, source],
        np.full(len(times), _core.OP_AT, np.uint8),
        np.zeros(len(times), np.uint32),
        np.ones(len(times), np.uint32),
        times,
        atomic=True,
        max_gap_ns=sweep.max_gap_ns,
    )
    if isinstance(rows, _core.AskServer):
        return rows
    status, _, _, poses, errors, *_ = rows
    return sweep.compensate(times, status, poses, dict(errors).__getitem__)


def _mask(ok: NDArray[np.bool_] | None, grid: tuple[int, ...]) -> NDArray[np.bool_] | None:
    if ok is None or (
        isinstance(ok, np.ndarray)
        and ok.shape == grid
        and ok.dtype == np.bool_
        and ok.flags.writeable
    ):
        return ok
    raise InvalidArgumentException(
        f"ok must be a writable bool array of the shape {grid}", field="ok"
    )


def _integer(time_ns: int, field: str) -> int:
    if isinstance(time_ns, (int, np.integer)) and -(1 << 63) < time_ns < 1 << 63:
        return int(time_ns)
    raise InvalidArgumentException(
        f"{field} must be an int of nanoseconds, not {time_ns!r}", field=field, value=str(time_ns)
    )


def _stamps(stamps_ns: ArrayLike, grid: tuple[int, ...]) -> NDArray[np.int64]:
    try:
        stamps = np.asarray(stamps_ns)
    except (ValueError, OverflowError):
        stamps = np.empty((), object)
    if stamps.dtype.kind not in "iu" and stamps.size:
        raise InvalidArgumentException(
            f"stamps_ns must be integers (nanoseconds), not {stamps.dtype}: make an array with "
            "dtype=np.int64",
            field="stamps_ns",
        )
    if stamps.dtype.kind == "u" and stamps.size and int(stamps.max()) >= 1 << 63:
        raise InvalidArgumentException(
            f"stamps_ns has {int(stamps.max())}; stamps are below 2^63", field="stamps_ns"
        )
    try:
        return np.broadcast_to(readable(stamps.astype(np.int64, copy=False)), grid)
    except ValueError:
        raise InvalidArgumentException(
            f"stamps_ns must have a stamp for each point, of the shape {grid} or one that "
            f"broadcasts to it, not {stamps.shape}",
            field="stamps_ns",
        ) from None
