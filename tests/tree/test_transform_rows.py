"""`TransformRows`: the rows of messages from the wire to the commit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from zenoh_tf import InvalidArgumentException
from zenoh_tf._core import TransformRows

POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
LINKS = [("map", f"f{n}", n, POSE) for n in range(5)]


@pytest.fixture
def rows() -> TransformRows:
    return TransformRows.of_tuples(LINKS)


def tuples(rows: TransformRows) -> list[Any]:
    columns = (rows.parent, rows.child, rows.stamp, rows.pose)
    return [
        (rows.names[parent], rows.names[child], stamp, tuple(pose))
        for parent, child, stamp, pose in zip(*(c.tolist() for c in columns), strict=True)
    ]


def test_of_tuples_and_of_arrays(rows: TransformRows) -> None:
    assert tuples(rows) == LINKS and len(rows) == 5
    assert rows.names == ["map", "f0", "f1", "f2", "f3", "f4"] and rows.newest_stamp == 4
    assert rows.nbytes == 5 * 72 + 6 * 88 + len("map") + 5 * len("f0")
    same = TransformRows(rows.names, rows.parent, rows.child, rows.stamp, rows.pose)
    assert same.columns() == rows.columns()


@pytest.mark.parametrize(
    ("which", "numbers", "names"),
    [
        (slice(None), [0, 1, 2, 3, 4], 6),
        (slice(1, 4), [1, 2, 3], 6),
        (slice(3, None), [3, 4], 3),  # few rows have only the names that they use
        (slice(2, 2), [], 0),
        (np.array([4, 0]), [4, 0], 3),
        (np.array([1, 1, 1]), [1, 1, 1], 6),
    ],
)
def test_some_rows(rows: TransformRows, which: slice, numbers: list[int], names: int) -> None:
    some = rows[which]
    assert tuples(some) == [LINKS[n] for n in numbers] and len(some.names) == names


@pytest.mark.parametrize("row", [-1, 5])
def test_a_number_without_a_row(rows: TransformRows, row: int) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        rows[np.array([row])]
    assert caught.value.field == "rows"


def test_rows_of_several_messages_have_each_name_once(rows: TransformRows) -> None:
    joined = TransformRows.join([rows[3:], TransformRows.of_tuples([]), rows[:1]])
    assert tuples(joined) == [LINKS[n] for n in (3, 4, 0)]
    assert joined.names == ["map", "f3", "f4", "f0"]
