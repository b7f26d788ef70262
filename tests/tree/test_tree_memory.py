"""Limits of what a tree holds for good: the memory of samples, and authorities."""

from __future__ import annotations

import pytest

from zenoh_tf import (
    InvalidArgumentException,
    LimitExceeded,
    StampedTransform,
    Transform,
    TransformTree,
)

MIB = 1 << 20


def samples(child: str, count: int) -> list[StampedTransform]:
    return [StampedTransform("map", child, stamp, Transform()) for stamp in range(1, count + 1)]


def test_a_write_that_needs_too_much_memory_is_refused() -> None:
    tree = TransformTree(max_memory_bytes=MIB)
    tree.set_transforms_xact(samples("base", 1000))
    with pytest.raises(LimitExceeded) as caught:
        tree.set_transforms_xact(samples("arm", 20_000))
    error = caught.value
    assert (error.field, error.limit, error.frame) == ("max_memory", MIB, "arm")
    assert tree.frames() == ["base", "map"]
    assert 0 < tree.stats()["memory_bytes"] <= MIB


def test_the_memory_of_removed_frames_is_used_again() -> None:
    tree = TransformTree(max_memory_bytes=MIB, max_frames=200)
    for number in range(100):
        tree.set_transforms_xact(samples(f"frame{number}", 4000))
        tree.remove_frame(f"frame{number}")


@pytest.mark.parametrize("value", [-1, 1, 65535])
def test_a_memory_limit_that_makes_no_sense(value: int) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        TransformTree(max_memory_bytes=value)
    assert caught.value.field == "max_memory_bytes"


def test_authorities_that_own_no_frame_give_way() -> None:
    tree = TransformTree()
    link = samples("base", 1)[0]
    tree.set_transform(samples("arm", 1)[0], "arm")
    for number in range(10_000):
        tree.set_transform(link, f"sensor{number}")
    names = [authority.name for authority in tree.authorities()]
    assert len(names) <= 4096
    assert {"arm", "sensor9999"} <= set(names)
    assert tree.frame("arm").authority == "arm"
