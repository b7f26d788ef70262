"""What only the server asks of a commit: an expiry, and a latest stamp."""

from __future__ import annotations

import time

import pytest

from zenoh_tf import InvalidArgumentException, TimeoutException, TransformTree
from zenoh_tf._core import TransformRows

POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def commit(tree: TransformTree, stamps: list[int], **how: object) -> list[int]:
    """One link from map to base with these stamps."""
    rows = TransformRows.of_tuples(("map", "base", stamp, POSE) for stamp in stamps)
    stored = tree._commit_rows(rows, **how)  # type: ignore[arg-type]
    return [int(result) for result in stored]


def test_a_commit_after_its_expiry_writes_nothing() -> None:
    tree = TransformTree()
    assert commit(tree, [1], expires_ns=time.monotonic_ns() + 10**12) == [1]
    expires_ns = time.monotonic_ns() - 1
    with pytest.raises(TimeoutException) as caught:
        commit(tree, [2], expires_ns=expires_ns)
    assert (caught.value.field, caught.value.limit) == ("expires_ns", expires_ns)
    assert tree.frame("base").newest_stamp_ns == 1


def test_rows_from_the_future() -> None:
    tree = TransformTree()
    with pytest.raises(InvalidArgumentException) as caught:
        commit(tree, [1, 11], max_stamp_ns=10)
    error = caught.value
    assert (error.field, error.frame, error.parent_frame) == ("stamp", "base", "map")
    assert (error.value, error.limit, error.stamp_ns) == (11, 10, 11)
    assert tree.frames() == []
    assert commit(tree, [1, 11, 10], max_stamp_ns=10, drop_old=True) == [1, 2, 1]
    assert tree.stats()["from_future"] == 1
    assert tree.frame("base").newest_stamp_ns == 10
