"""Each open difference by itself, in the shortest history that shows it."""

from __future__ import annotations

import pytest

from zenoh_tf import (
    ConnectivityException,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformTree,
)


def link(parent: str, child: str, stamp_ns: int, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


@pytest.mark.xfail(strict=True)
def test_depth_that_is_just_reached() -> None:
    tree = TransformTree(max_depth=1)
    tree.set_transform(link("map", "base", 10))
    tree.set_transform(link("elsewhere", "island", 10))
    with pytest.raises(ConnectivityException):
        tree.lookup_transform("base", "island", 10)


@pytest.mark.xfail(strict=True, raises=AssertionError)
def test_two_ways_in_a_past_loop() -> None:
    """At 10, base is under tool and tool under base; since then, base is a root's child."""
    tree = TransformTree()
    tree.set_transform(link("base", "tool", 10, 1.0))
    tree.set_transform(link("map", "tool", 20))
    tree.set_transform(link("tool", "base", 10, 5.0))
    tree.set_transform(link("tool", "base", 12, 5.0))
    latest = tree.lookup_transform("base", "tool")
    at = tree.lookup_transform("base", "tool", latest.stamp_ns)
    assert latest == at


@pytest.mark.xfail(strict=True)
def test_refused_after_a_time_jump() -> None:
    tree = TransformTree(time_jump="clear")
    tree.set_transform(link("map", "base", 100_000_000_000))
    with pytest.raises(InvalidArgumentException):
        tree.set_transforms_xact([link("map", "base", 1), link("base", "map", 1)])
    assert tree.can_transform("map", "base")  # refused: nothing was written
