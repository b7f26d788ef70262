"""The open difference by itself, in the shortest history that shows it."""

from __future__ import annotations

import pytest

from zenoh_tf import (
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformTree,
)


def link(parent: str, child: str, stamp_ns: int, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


@pytest.mark.xfail(strict=True)
def test_refused_after_a_time_jump() -> None:
    tree = TransformTree(time_jump="clear")
    tree.set_transform(link("map", "base", 100_000_000_000))
    with pytest.raises(InvalidArgumentException):
        tree.set_transforms_xact([link("map", "base", 1), link("base", "map", 1)])
    assert tree.can_transform("map", "base")  # refused: nothing was written
