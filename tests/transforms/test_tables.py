"""Transforms as NumPy's matrices, Arrow's tables, data frames, and SciPy's stacks."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pandas as pd
import polars as pl
import pytest

from zenoh_tf import StampedTransform, Transform, TransformArray, TransformTree

S = 10**9


@pytest.fixture
def array() -> TransformArray:
    """Three answers and one failure, which comes second."""
    tree = TransformTree()
    for i in range(4):
        X = Transform.from_rpy(0.1 * i, -0.2 * i, 0.3 + i, (i, 2 * i, -i))
        tree.set_transform(StampedTransform("map", "base", i * S, X))
    return tree.sample("map", "base", np.array([0, 9 * S, S // 2, 3 * S]))


def test_numpy_gets_matrices(array: TransformArray) -> None:
    X = Transform.from_rpy(0.1, 0.2, 0.3, (1, 2, 3))
    np.testing.assert_array_equal(np.asarray(X), X.matrix())
    assert np.asarray(X, np.float32).dtype == np.float32
    np.testing.assert_allclose(np.asarray(X) @ np.asarray(X), (X @ X).matrix(), atol=1e-12)
    assert np.array([X, X]).shape == (2, 4, 4)
    matrices = np.asarray(array)
    assert matrices.shape == (4, 4, 4)
    for row in (0, 2, 3):
        np.testing.assert_allclose(matrices[row], array[row].matrix(), atol=1e-14)
    assert np.isnan(matrices[1, :3]).all()
    assert np.isnan(matrices[1, 3, 3])
    for each in (X, array):
        with pytest.raises(ValueError, match="without a copy"):
            np.asarray(each, copy=False)


def test_arrow(array: TransformArray) -> None:
    table = array.to_arrow()
    assert table.num_rows == 4
    assert table.column("stamp").cast("int64").to_pylist() == array.stamps_ns.tolist()
    assert table.column("error").to_pylist() == [None, "ForwardExtrapolationException", None, None]
    assert table.column("x").null_count == 1
    assert table.column("target").to_pylist() == ["map"] * 4
    assert table.column("qw").to_pylist()[3] == array.poses[3, 6]
    rows = TransformArray(
        np.zeros(2, np.uint8), np.arange(2), np.eye(2, 7), ["a", "b"], ["c", "d"]
    ).to_arrow()
    assert rows.column("source").to_pylist() == ["c", "d"]
    assert TransformArray(np.zeros(1, np.uint8), np.arange(1), np.eye(1, 7)).to_arrow().column(
        "target"
    ).to_pylist() == [None]


def test_data_frames(array: TransformArray) -> None:
    frame = array.to_pandas()
    assert isinstance(frame, pd.DataFrame)
    assert frame["x"].isna().tolist() == [False, True, False, False]
    assert frame["stamp"].iloc[2] == pd.Timestamp(S // 2, tz="UTC")
    polar = pl.DataFrame(array)
    assert polar["stamp"].to_physical().to_list() == array.stamps_ns.tolist()
    assert polar["y"].null_count() == 1


def test_pandas_that_is_missing() -> None:
    """In a process of its own: pyarrow keeps a pandas that it has imported."""
    script = """
import sys
from zenoh_tf import TransformTree

class NoPandas:
    def find_spec(self, name, *_):
        if name == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name=name)

sys.meta_path.insert(0, NoPandas())
try:
    TransformTree().sample("map", "base", [1]).to_pandas()
except ImportError as error:
    print(error.name, error)
"""
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert ran.stdout.startswith("pandas data frames need pandas, ")
    assert ran.stdout.endswith("install it with: pip install pandas\n")
