"""Many transforms as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from zenoh_tf import _core
from zenoh_tf._core import Transform
from zenoh_tf.clouds.points import output_like, readable, real_numbers
from zenoh_tf.errors import BY_CODE, InvalidArgumentException, TransformException
from zenoh_tf.text.times import seconds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pandas
    import pyarrow
    from numpy.typing import ArrayLike, NDArray

    Names = str | Sequence[str] | None


def summary(status: NDArray[np.uint8], targets: Names, sources: Names) -> str:
    """Return how many rows there are, of what, how many failed and with which errors.

    Args:
        status: (n,) the rows' codes of errors; 0 where there is none.
        targets: The targets' names: one for all rows, or (n,); None if unknown.
        sources: The sources' names, in the same form.
    """
    parts = [f"{len(status)} rows"]
    if isinstance(targets, str) and isinstance(sources, str):
        parts[0] += f" of {sources!r} in {targets!r}"
    if failed := np.count_nonzero(status):
        codes = np.unique(status[status != 0]).tolist()
        errors = (BY_CODE.get(code, TransformException).__name__ for code in codes)
        parts.append(f"{failed} failed with {', '.join(errors)}")
    return ", ".join(parts)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class TransformArray:
    """Transforms as columns, one per row: the answers to many lookups.

    Row i is `X_target_source` of lookup i. A row that failed has an error's code in `status` and
    NaN in `poses`, and every result made of it is NaN or a failed row again.

    Example:
        >>> path = tree.sample("map", "lidar", stamps_ns)
        >>> path[path.ok].apply(points[path.ok])

    Attributes:
        status: (n,) uint8, 0 or the code of an error (`zenoh_tf.errors.BY_CODE`).
        stamps_ns: (n,) int64, the time of each answer in nanoseconds; in rows that failed the time
            that was asked for, or 0.
        poses: (n, 7) float64 rows x, y, z (metres), qx, qy, qz, qw; NaN in rows that failed.
        targets: The targets' names: one for all rows, or (n,); None if unknown.
        sources: The sources' names, in the same form.
        gaps_ns: (n,) int64, the longest gap that each row was interpolated over, in nanoseconds, as
            `StampedTransform.gap_ns`; 0 where there is none. None stands for zeros.
    """

    status: NDArray[np.uint8]
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    targets: Names = None
    sources: Names = None
    gaps_ns: NDArray[np.int64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.gaps_ns is None:
            object.__setattr__(self, "gaps_ns", np.zeros(len(self.status), np.int64))

    @classmethod
    def _answers(
        cls, asked_ns: ArrayLike | None, status: Any, stamps_ns: Any, *columns: Any
    ) -> TransformArray:
        """Make one of a bulk lookup's columns, whose `stamps_ns` is 0 in rows that failed."""
        if asked_ns is not None and np.count_nonzero(status):
            stamps_ns = np.where(status, np.asarray(asked_ns, np.int64), stamps_ns)
        return cls(status, stamps_ns, *columns)

    # Without this NumPy would treat `ndarray @ self` as a product of object arrays.
    __array_ufunc__ = None

    @property
    def translations(self) -> NDArray[np.float64]:
        """The translations: a view (n, 3) of `poses`, metres."""
        return self.poses[:, :3]

    @property
    def rotations(self) -> NDArray[np.float64]:
        """The rotations: a view (n, 4) of `poses`, quaternions (x, y, z, w)."""
        return self.poses[:, 3:]

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Which rows have an answer: a new (n,) bool array."""
        return np.equal(self.status, 0)

    def raise_for_status(self) -> TransformArray:
        """Return this array if every row has an answer, so that calls can be chained.

        Example: `tree.sample("map", "base", stamps_ns).raise_for_status().translations`

        Raises:
            TransformException: A row failed; the class is that of the first failed row's error,
                and the message names the row. A `lookup_transform` of that row says more.
        """
        if self.status.any():
            raise self._error(int(self.status.nonzero()[0][0]))
        return self

    def apply(self, points: ArrayLike, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return points that are given in source, expressed in target: row i's R p + t.

        Args:
            points: Metres, real numbers, any strides. (3,): the same point for every row. (n, 3):
                point i for row i. (n, m, 3): m points for each row. A first axis of 1 stands for
                every row.
            out: Array of the result's shape to write to, float32 or float64. It may be `points`
                itself, but must not overlap with it otherwise.

        Returns:
            `out`, or a new float64 array: (n, 3), or (n, m, 3) for m points per row; NaN in rows
            that failed.

        Raises:
            InvalidArgumentException: `points` has another shape or is not of real numbers, or `out`
                does not fit.
        """
        values = real_numbers(points)
        if not 1 <= values.ndim <= 3 or values.shape[-1] != 3:
            raise _wrong_shape(values, len(self))
        if values.ndim > 1 and values.shape[0] not in (1, len(self)):
            raise _wrong_shape(values, len(self))
        columns = values.shape[1:-1] if values.ndim == 3 else ()
        clouds = np.broadcast_to(values, (len(self), *columns, 3))
        result = output_like(clouds, out, np.float64)
        grid = (len(self), *(columns or (1,)), 3)
        written = result.reshape(grid) if not columns else result
        target = readable(written)
        _core.map_rows(
            np.ascontiguousarray(self.poses),
            clouds.reshape(grid) if not columns else clouds,
            target,
        )
        if target is not written:
            written[...] = target
        return result

    def inverse(self) -> TransformArray:
        """Return `X_source_target` of every row, with the same stamps and status, in metres.

        Rotations must be of unit length.
        """
        poses = np.empty_like(self.poses)
        poses[:, 3:6] = -self.poses[:, 3:6]
        poses[:, 6] = self.poses[:, 6]
        poses[:, :3] = _rotate(poses[:, 3:], -self.poses[:, :3])
        return TransformArray(
            self.status, self.stamps_ns, poses, self.sources, self.targets, self.gaps_ns
        )

    def __matmul__(self, other: TransformArray | Transform) -> TransformArray:
        """Return `X_ac = X_ab @ X_bc`, row by row; a Transform stands for every row.

        Stamps are those of the left array, gaps the longer ones. A row fails if either fails, with
        the left's code first.
        """
        if isinstance(other, Transform):
            poses = _compose(self.poses, np.array([other.pose()]))
            return TransformArray(
                self.status, self.stamps_ns, poses, self.targets, gaps_ns=self.gaps_ns
            )
        if not isinstance(other, TransformArray):
            return NotImplemented
        if len(self) != len(other):
            raise InvalidArgumentException(
                f"cannot compose {len(self)} rows with {len(other)}: @ goes row by row",
                field="other",
            )
        status = np.where(self.status != 0, self.status, other.status)
        poses = _compose(self.poses, other.poses)
        gaps_ns = np.maximum(self.gaps_ns, other.gaps_ns)
        return TransformArray(status, self.stamps_ns, poses, self.targets, other.sources, gaps_ns)

    def __rmatmul__(self, other: Transform) -> TransformArray:
        """Return `X_ac = X_ab @ X_bc`, where the Transform `X_ab` stands for every row."""
        if not isinstance(other, Transform):
            return NotImplemented
        poses = other.apply_poses(self.poses)
        return TransformArray(self.status, self.stamps_ns, poses, None, self.sources, self.gaps_ns)

    def matrices(self) -> NDArray[np.float64]:
        """Return the homogeneous matrices: (n, 4, 4) float64, metres; NaN in rows that failed."""
        x, y, z, w = self.rotations.T
        found = np.zeros((len(self), 4, 4))
        found[:, :3, 3] = self.translations
        found[:, 3, 3] = 1 + 0 * w  # NaN if the row failed
        found[:, 0, 0], found[:, 1, 1] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z)
        found[:, 2, 2] = 1 - 2 * (x * x + y * y)
        for row, column, a, b in ((0, 1, x * y, z * w), (2, 0, x * z, y * w), (1, 2, y * z, x * w)):
            found[:, row, column], found[:, column, row] = 2 * (a - b), 2 * (a + b)
        return found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return `matrices()` to NumPy: `numpy.asarray(array)`."""
        if copy is False:
            raise ValueError("a TransformArray gives no array without a copy: use poses")
        return self.matrices().astype(dtype or np.float64, copy=False)

    def to_arrow(self) -> pyarrow.Table:
        """Return a table of Arrow, a row for each of this array's.

        Columns: target and source (text, or null), stamp (nanoseconds since 1970, UTC), x, y, z in
        metres, qx, qy, qz, qw (null where the row failed), gap_ns, and error: the name of its
        class, or null. `to_arrow().column("stamp").cast("int64")` is `stamps_ns`.

        Raises:
            ImportError: pyarrow is not installed: `pip install 'zenoh-tf[arrow]'`.
        """
        from zenoh_tf.arrow import to_table  # noqa: PLC0415 - an optional extra

        return to_table(self)

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """Arrow's protocol, as of `to_arrow`: `polars.DataFrame(array)` copies nothing else."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table of `to_arrow` as a data frame of pandas.

        Raises:
            ImportError: pyarrow or pandas is not installed: `pip install 'zenoh-tf[arrow]' pandas`.
        """
        table = self.to_arrow()
        try:
            return table.to_pandas()
        except ImportError as error:
            raise ImportError(
                f"data frames need pandas, which cannot be imported ({error}); "
                "install it with: pip install pandas",
                name="pandas",
            ) from error

    def __len__(self) -> int:
        return len(self.status)

    @overload
    def __getitem__(self, rows: int | np.integer[Any]) -> Transform: ...
    @overload
    def __getitem__(
        self, rows: slice | list[int] | NDArray[np.bool_] | NDArray[np.integer[Any]]
    ) -> TransformArray: ...
    def __getitem__(
        self,
        rows: int
        | np.integer[Any]
        | slice
        | list[int]
        | NDArray[np.bool_]
        | NDArray[np.integer[Any]],
    ) -> Transform | TransformArray:
        """Return one row as a `Transform`, or the rows of a slice, mask or array of indexes.

        Raises:
            TransformException: The one row failed; the class is that of its error.
            IndexError: There is no such row.
        """
        if isinstance(rows, (int, np.integer)):
            if self.status[rows]:
                raise self._error(int(rows) % len(self))
            return Transform.from_pose(self.poses[rows])
        return TransformArray(
            self.status[rows],
            self.stamps_ns[rows],
            self.poses[rows],
            _names_of(self.targets, rows),
            _names_of(self.sources, rows),
            self.gaps_ns[rows],
        )

    def __iter__(self) -> Iterator[Transform]:
        """Iterate over the rows as `Transform`; raises the error of a row that failed."""
        return (self[row] for row in range(len(self)))

    def __repr__(self) -> str:
        return f"TransformArray({summary(self.status, self.targets, self.sources)})"

    def _repr_html_(self) -> str:
        from zenoh_tf import notebook  # noqa: PLC0415 - most programs need none

        return notebook.of_array(self)

    def frames_of(self, row: int) -> tuple[str | None, str | None]:
        """Return the names of a row's target and source; None for one that is unknown.

        Args:
            row: The number of the row.

        Raises:
            IndexError: There is no such row.
        """
        return _name_of(self.targets, row), _name_of(self.sources, row)

    def _error(self, row: int) -> TransformException:
        kind = BY_CODE.get(int(self.status[row]), TransformException)
        failed = int(np.count_nonzero(self.status))
        rows = "row" if failed == 1 else "rows"
        target, source = self.frames_of(row)
        stamp_ns = int(self.stamps_ns[row])
        at = f" at {seconds(stamp_ns)} s" if stamp_ns else ""
        asked, more = "", ""
        if target is not None and source is not None:
            asked = f" ({source!r} in {target!r}{at})"
            more = "; lookup_transform of the row says more"
        reason = " ".join((kind.__doc__ or "").split(".")[0].split(";")[0].split())
        reason = reason.replace("``", "'")
        return kind(
            f"row {row} of {len(self)}{asked} failed with {kind.__name__}: "
            f"{reason[:1].lower()}{reason[1:]}; {failed} {rows} failed in all{more}",
            field="status",
            value=row,
            target_frame=target,
            source_frame=source,
            stamp_ns=stamp_ns or None,
        )


def _name_of(names: Names, row: int) -> str | None:
    return names if names is None or isinstance(names, str) else names[row]


def _names_of(names: Names, rows: Any) -> Names:
    """The names of the rows that an index of NumPy selects."""
    if names is None or isinstance(names, str):
        return names
    return [names[row] for row in np.arange(len(names))[rows]]


def _wrong_shape(values: NDArray[np.float64], rows: int) -> InvalidArgumentException:
    return InvalidArgumentException(
        f"points must have the shape (3,), ({rows}, 3) or ({rows}, m, 3), not {values.shape}",
        field="points",
    )


def _rotate(quaternions: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate (..., 3) by (..., 4): v + w u + q x u with u = 2 q x v, as the native code does."""
    axis = quaternions[..., :3]
    u = 2 * np.cross(axis, vectors)
    result: NDArray[np.float64] = vectors + quaternions[..., 3:] * u + np.cross(axis, u)
    return result


def _compose(ab: NDArray[np.float64], bc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose rows of X_ab @ X_bc."""
    ac = np.empty(np.broadcast_shapes(ab.shape, bc.shape))
    ac[:, :3] = ab[:, :3] + _rotate(ab[:, 3:], bc[:, :3])
    p, w = ab[:, 3:6], ab[:, 6:]
    q, v = bc[:, 3:6], bc[:, 6:]
    ac[:, 3:6] = w * q + v * p + np.cross(p, q)
    ac[:, 6:] = w * v - np.sum(p * q, axis=1, keepdims=True)
    return ac
