"""The embedded tree through Python. The core's own rules are tested in tests/core."""

from typing import Any

import numpy as np
import pytest

from tests.support.small_robot import link
from zenoh_tf import (
    ConnectivityException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    StampedTransform,
    TransformTree,
)

S = 1_000_000_000


def x_of(stamped: StampedTransform) -> float:
    return stamped.transform.pose()[0]


def test_columns(tree: TransformTree) -> None:
    stamps = np.arange(10 * S, 21 * S, S)
    path = tree.sample("map", "camera", stamps)
    assert (path.status == 0).all()
    np.testing.assert_allclose(path.translations[:, 0], stamps / S + 0.5)
    np.testing.assert_array_equal(path.stamps_ns, stamps)
    mixed = tree.lookup_transforms(["map", "map", "nope"], ["camera", "arm", "map"], None)
    assert mixed.status.tolist() == [0, 0, LookupException.code]
    assert mixed.stamps_ns.tolist()[:2] == [20 * S, 18 * S]
    assert np.isnan(mixed.poses[2]).all()  # translation and rotation
    assert not np.isnan(mixed.poses[:2]).any()
    assert len(tree.lookup_transforms([], "map", [])) == 0
    with pytest.raises(InvalidArgumentException) as caught:
        tree.lookup_transforms(["map", "map"], "arm", [1, 2, 3])
    assert caught.value.field == "stamps_ns"
    with pytest.raises(InvalidArgumentException):
        tree.sample("map", "arm", np.array([1.5]))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint32, np.uint64, np.int16, np.int64, ">u8"])
def test_stamps_of_any_integer_type(tree: TransformTree, dtype: Any) -> None:
    """Unsigned arrays were rejected."""
    stamps = np.array([1, 2, 100], dtype)
    got = tree.sample("base", "camera", stamps)
    assert got.ok.all()
    assert got.stamps_ns.tolist() == [1, 2, 100]
    assert tree.sample("base", "camera", stamps[2]).stamps_ns.tolist() == [100]
    assert tree.lookup_transforms("base", "camera", np.array(7, dtype)).stamps_ns.tolist() == [7]
    for same in (stamps.tolist(), np.repeat(stamps, 2)[::2]):  # a list, and not contiguous
        assert tree.sample("base", "camera", same).stamps_ns.tolist() == [1, 2, 100]


def test_repr_of_a_tree() -> None:
    tree = TransformTree(cache_time_s=0.1, concurrency="2pl")
    assert repr(tree) == "TransformTree(0 frames, cache_time_s=0.1, concurrency='2pl')"
    tree.set_transform(link("map", "base", 1))
    tree.set_transform(link("map", "cup", 1))
    tree.remove_frame("cup")
    assert "TransformTree(2 frames" in repr(tree)


def test_internals_are_private() -> None:
    public = {name for name in dir(TransformTree) if not name.startswith("_")}
    internal = {
        name for name in public if name.endswith(("_rows", "_columns", "_record", "_records"))
    }
    assert not internal


def test_limits() -> None:
    tree = TransformTree(max_frames=3, max_samples_per_frame=4)
    tree.set_transforms_xact([link("a", "b", 1), link("b", "c", 1)])
    with pytest.raises(LimitExceeded) as caught:
        tree.set_transform(link("c", "d", 1))
    assert (caught.value.field, caught.value.limit) == ("max_frames", 3)
    for stamp in range(10):
        tree.set_transform(link("a", "b", stamp, float(stamp)))
    assert tree.frame("b").samples == 4
    assert tree.frame("b").evicted == 6
    for arguments in ({"cache_time_s": 0}, {"concurrency": "none"}, {"max_frames": 0}):
        with pytest.raises(InvalidArgumentException):
            TransformTree(**arguments)


def test_a_loop_of_past_links_without_a_limit_of_depths() -> None:
    tree = TransformTree(max_depth=0)
    for parent, child, stamp in (("top", "f0", 10), ("f0", "f1", 10), ("f1", "f0", 5)):
        tree.set_transform(link(parent, child, stamp))
    tree.set_transform(link("f0", "f1", 5))
    tree.set_transform(link("aside", "other", 5))
    with pytest.raises(LookupException, match="runs in a loop") as caught:
        tree.lookup_transform("aside", "f1", 5)
    assert caught.value.limit is None


def test_a_path_that_ends_at_the_depth_limit_is_not_too_deep() -> None:
    tree = TransformTree(max_depth=1)
    tree.set_transform(link("map", "base", 10))
    tree.set_transform(link("elsewhere", "island", 10))
    with pytest.raises(ConnectivityException):
        tree.lookup_transform("base", "island", 10)


def test_the_latest_common_lookup_is_that_at_its_time_in_a_past_loop_too() -> None:
    """At 10, base is under tool and tool under base; since then, base is a root's child."""
    tree = TransformTree()
    tree.set_transform(link("base", "tool", 10, 1.0))
    tree.set_transform(link("map", "tool", 20))
    tree.set_transform(link("tool", "base", 10, 5.0))
    tree.set_transform(link("tool", "base", 12, 5.0))
    latest = tree.lookup_transform("base", "tool")
    at = tree.lookup_transform("base", "tool", latest.stamp_ns)
    assert latest == at


def test_one_authority_per_frame() -> None:
    tree = TransformTree(one_authority_per_frame=True)
    tree.set_transform(link("map", "base", 1), authority="a")
    with pytest.raises(InvalidArgumentException, match="published by 'a'"):
        tree.set_transform(link("map", "base", 2), authority="b")


def test_names_are_any_text(tree: TransformTree) -> None:
    for name in ("größe", "机器人/手", "a b\n", "x\x01y", "*", "🤖"):
        tree.set_transform(link("map", name, 15 * S, 2.0))
        assert tree.lookup_transform("map", name).child_frame == name
    with pytest.raises(InvalidArgumentException):
        tree.lookup_transform("map", "\ud800")
    for parent, child in (("map", "x\0y"), ("\0", "x")):
        with pytest.raises(InvalidArgumentException, match="zero character") as caught:
            tree.set_transform(link(parent, child, 15 * S, 2.0))
        assert caught.value.field == ("child_frame" if parent == "map" else "parent_frame")


def test_a_refused_commit_registers_no_authority() -> None:
    tree = TransformTree()
    for i in range(5000):  # more than there is room for
        with pytest.raises(InvalidArgumentException):
            tree.set_transform(link("a", "a", 1), authority=f"rubbish{i}")
        tree.set_transform(link("a", "b", 100 * S))
        with pytest.raises(InvalidArgumentException):
            tree.set_transforms_xact([link("a", "b", 1)], authority=f"late{i}")
    tree.set_transform(link("a", "b", 101 * S), authority="good")
    assert tree.frame("b").authority == "good"
