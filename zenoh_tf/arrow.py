"""Transforms as tables of Apache Arrow (``pip install 'zenoh-tf[arrow]'``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zenoh_tf.errors import BY_CODE, TransformException

try:
    import pyarrow as pa
except ImportError as error:
    raise ImportError(
        f"tables need pyarrow, which cannot be imported ({error}); "
        "install it with: pip install pyarrow",
        name="pyarrow",
    ) from error

if TYPE_CHECKING:
    from zenoh_tf.array import Names, TransformArray

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")


def to_table(array: TransformArray) -> pa.Table:
    """Return the table that `TransformArray.to_arrow` describes."""
    failed = np.not_equal(array.status, 0)
    classes = {code: BY_CODE.get(code, TransformException).__name__ for code in range(256)}
    columns = {
        "target": _names(array.targets, len(array)),
        "source": _names(array.sources, len(array)),
        "stamp": pa.array(array.stamps_ns).cast(pa.timestamp("ns", "UTC")),
        **{name: pa.array(array.poses[:, at], mask=failed) for at, name in enumerate(_POSE)},
        "gap_ns": pa.array(array.gaps_ns),
        "error": pa.array(
            [classes[code] if code else None for code in array.status.tolist()], pa.string()
        ),
    }
    return pa.table(columns)


def _names(names: Names, rows: int) -> pa.Array:
    """One name for all rows takes no memory for each."""
    if names is None or isinstance(names, str):
        return pa.array([names], pa.string()).take(pa.array(np.zeros(rows, np.int64)))
    return pa.array(list(names), pa.string())
