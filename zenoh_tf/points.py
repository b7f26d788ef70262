"""Arrays of points and of their stamps, as the native kernels read them.

Internal: for the trees and the client, which deskew sweeps, and for `TransformArray`.

Thread safety: all functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from zenoh_tf import _core
from zenoh_tf.errors import InvalidArgumentException

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from zenoh_tf._core import AskServer, SharedTree, Tree

    Points = NDArray[Any]  # float32 or float64

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


class Sweep:
    """The points of a sweep with the time of each, and the array for the result.

    Raises:
        InvalidArgumentException: The arrays do not fit each other, or hold other values.
    """

    def __init__(
        self, points: ArrayLike, stamps_ns: ArrayLike, at_ns: int, out: Points | None
    ) -> None:
        values = real_numbers(points)
        if not 1 <= values.ndim <= 3 or values.shape[-1] != 3:
            raise InvalidArgumentException(
                f"points must have the shape (n, 3) or (rows, columns, 3), not {values.shape}",
                field="points",
            )
        #: What the caller gets.
        self.out = output_like(values, out, values.dtype)
        self.at_ns = _integer(at_ns)
        grid = values.shape[:-1]
        shape = (1,) * (2 - len(grid)) + grid
        #: Of the shapes (rows, columns, 3) and (rows, columns).
        self.points = values.reshape((*shape, 3)) if values.ndim < 3 else values
        self.stamps = _stamps(stamps_ns, grid).reshape(shape)
        written = self.out if self.out.ndim == 3 else self.out.reshape((*shape, 3))
        # Native code cannot write to odd addresses.
        self._written = written
        self.target = readable(written)

    def done(self) -> Points:
        """The result, once it is in `target`."""
        if self.target is not self._written:
            self._written[...] = self.target
        return self.out

    def times(self) -> NDArray[np.int64]:
        """Every time at which the motion is needed, once, ascending; `at_ns` too."""
        return np.unique(np.append(np.unique(self.stamps), self.at_ns))

    def compensate(self, times: NDArray[np.int64], poses: NDArray[np.float64]) -> Points:
        """Return the result from `X_fixed_source` at each of `times`."""
        at = poses[int(np.searchsorted(times, self.at_ns))].tolist()
        _core.deskew_by_samples(self.points, self.stamps, self.target, times, poses, at)
        return self.done()


def deskew(tree: Tree | SharedTree, sweep: Sweep, source: str, fixed: str) -> Points | AskServer:
    """Move a sweep's points by a tree of this process; a mapped one may return an AskServer."""
    done = tree._deskew(sweep.points, sweep.stamps, sweep.target, source, fixed, sweep.at_ns)
    if isinstance(done, _core.AskServer):
        return done
    if done:
        return sweep.done()
    # Frames were reparented, so the path may differ from time to time.
    times = sweep.times()
    rows = tree._read_rows(
        [fixed, source],
        np.full(len(times), _core.OP_AT, np.uint8),
        np.zeros(len(times), np.uint32),
        np.ones(len(times), np.uint32),
        times,
        atomic=True,
    )
    if isinstance(rows, _core.AskServer):
        return rows
    _, _, _, poses, errors, _ = rows
    for _, error in errors:
        raise error
    return sweep.compensate(times, poses)


def _integer(at_ns: int) -> int:
    if isinstance(at_ns, (int, np.integer)) and -(1 << 63) < at_ns < 1 << 63:
        return int(at_ns)
    raise InvalidArgumentException(
        f"at_ns must be an int of nanoseconds, not {at_ns!r}", field="at_ns", value=str(at_ns)
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
