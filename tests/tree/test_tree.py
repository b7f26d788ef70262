"""The embedded tree through Python. The core's own rules are tested in tests/core."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from tests.support.small_robot import link
from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LatestTransform,
    LimitExceeded,
    LookupException,
    NoDataForExtrapolationException,
    StampedTransform,
    Transform,
    TransformTree,
    errors,
)

S = 1_000_000_000


def x_of(stamped: StampedTransform) -> float:
    return stamped.transform.pose()[0]


def test_lookups(tree: TransformTree) -> None:
    at = tree.lookup_transform("map", "camera", 15 * S)
    assert (at.parent_frame, at.child_frame, at.stamp_ns) == ("map", "camera", 15 * S)
    assert x_of(at) == pytest.approx(15.5)
    assert x_of(tree.lookup_transform("camera", "map", 15 * S)) == pytest.approx(-15.5)
    common = tree.lookup_transform("map", "arm")
    assert common.stamp_ns == 18 * S
    assert x_of(common) == pytest.approx(19.0)
    assert tree.latest_common_time("map", "arm") == 18 * S
    assert tree.latest_common_time("base", "camera") is None
    assert tree.lookup_transform("base", "camera").stamp_ns == 0
    full = tree.lookup_transform_full("arm", 12 * S, "arm", 18 * S, "map")
    assert full.stamp_ns == 12 * S
    assert x_of(full) == pytest.approx(6.0)
    assert tree.lookup_transform("base", "base", 3).transform == Transform()
    assert tree.lookup_transform("base", "base").stamp_ns == 20 * S


def test_latest(tree: TransformTree) -> None:
    for lookup in (tree.lookup_latest_transform, tree.lookup_latest_transform_xact):
        latest = lookup("map", "arm")
        assert isinstance(latest, LatestTransform)
        assert (latest.stamp_ns, latest.newest_stamp_ns) == (18 * S, 20 * S)
        assert x_of(latest) == pytest.approx(21.0)
    several = tree.lookup_latest_transforms_xact([("map", "arm"), ("arm", "camera")])
    assert [x_of(s) for s in several] == pytest.approx([21.0, -0.5])


def test_errors_and_their_facts(tree: TransformTree) -> None:
    def error(kind: type[errors.TransformException], *question: object) -> dict[str, object]:
        assert not tree.can_transform(*question)  # type: ignore[arg-type]
        with pytest.raises(kind) as caught:
            tree.lookup_transform(*question)  # type: ignore[arg-type]
        assert type(caught.value) is kind
        return caught.value.facts

    tree.set_transform(link("elsewhere", "island", 15 * S))
    assert error(LookupException, "map", "nowhere")["frame"] == "nowhere"
    facts = error(ConnectivityException, "map", "island", 15 * S)
    assert facts == {
        "target_frame": "map",
        "source_frame": "island",
        "target_root": "map",
        "source_root": "elsewhere",
        "stamp_ns": 15 * S,
    }
    wanted = {"target_frame": "map", "source_frame": "arm", "frame": "arm", "parent_frame": "base"}
    span = {"oldest_stamp_ns": 12 * S, "newest_stamp_ns": 18 * S}
    facts = error(ForwardExtrapolationException, "map", "arm", 19 * S)
    assert facts == {**wanted, **span, "stamp_ns": 19 * S}
    facts = error(BackwardExtrapolationException, "map", "arm", 11 * S)
    assert facts == {**wanted, **span, "stamp_ns": 11 * S}
    assert error(NoDataForExtrapolationException, "elsewhere", "island", S)["stamp_ns"] == S
    assert issubclass(NoDataForExtrapolationException, ExtrapolationException)
    for name in ("", "/map", "/"):
        assert error(InvalidArgumentException, name, "arm")["field"] == "target_frame"
        assert error(InvalidArgumentException, "arm", name)["field"] == "source_frame"


@pytest.mark.parametrize(
    ("bad", "field"),
    [
        (StampedTransform("a", "a", 1, Transform()), "child_frame"),
        (StampedTransform("a", "", 1, Transform()), "child_frame"),
        (StampedTransform("/", "b", 1, Transform()), "parent_frame"),
        (StampedTransform("a", "b", 1, Transform((float("nan"), 0, 0))), "translation"),
        (StampedTransform("a", "b", 1, Transform((float("inf"), 0, 0))), "translation"),
        (StampedTransform("a", "b", 1, Transform(rotation=(0, 0, 0, float("nan")))), "rotation"),
        (StampedTransform("a", "b", 1, Transform(rotation=(0, 0, 0, 0))), "rotation"),
        (StampedTransform("a", "b", 1, Transform(rotation=(0, 0, 0, 2))), "rotation"),
        (StampedTransform("map", "b" * 256, 1, Transform()), "max_name_bytes"),
    ],
)
def test_what_is_rejected(tree: TransformTree, bad: StampedTransform, field: str) -> None:
    frames = tree.frames()
    for write in (tree.set_transform, lambda s: tree.set_transforms_xact([link("x", "y", 1), s])):
        with pytest.raises((InvalidArgumentException, LimitExceeded)) as caught:
            write(bad)
        assert caught.value.field == field
    assert tree.frames() == frames


def test_a_transaction_is_all_or_nothing(tree: TransformTree) -> None:
    frames = tree.frames()
    with pytest.raises(InvalidArgumentException) as caught:
        tree.set_transforms_xact([link("map", "new", 30 * S), link("map", "base", 1 * S)])
    assert (caught.value.frame, caught.value.field) == ("base", "stamp_ns")
    with pytest.raises(InvalidArgumentException, match="cycle"):
        tree.set_transforms_xact([link("map", "new", 30 * S), link("arm", "map", 30 * S)])
    assert tree.frames() == frames
    assert tree.set_transform(link("map", "base", 1 * S)) is False  # single: dropped
    assert tree.set_transform(link("map", "base", 10 * S, 5.0)) is True  # exactly as old as allowed
    tree.set_transforms_xact([])


def test_a_leading_slash_is_stripped_where_frames_are_set(tree: TransformTree) -> None:
    tree.set_transform(link("/map", "/mast", S))
    assert tree.parent("mast") == "map"
    with pytest.raises(InvalidArgumentException, match="'/mast' is spelled 'mast'"):
        tree.frame("/mast")


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


@pytest.mark.parametrize(
    "stamps",
    [
        np.array([12 * S, -(2**63)], np.int64),
        np.array([12 * S, 2**63], np.uint64),
        np.array([2**64 - 1], np.uint64),
        [2**63],
        [-(2**63)],
        [2**64],
        [-(2**63) - 1],
        -(2**63),
        2**63,
        np.uint64(2**63),
        [True, False],
    ],
)
def test_stamps_out_of_range_are_invalid(tree: TransformTree, stamps: Any) -> None:
    """-2^63 in an array meant the latest common time, which None alone means."""
    for look_up in (
        lambda: tree.sample("map", "base", stamps),
        lambda: tree.lookup_transforms(["map"] * np.size(stamps), "base", stamps),
    ):
        with pytest.raises(InvalidArgumentException) as caught:
            look_up()
        assert caught.value.field == "stamps_ns"


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


def test_introspection(tree: TransformTree) -> None:
    assert tree.frames() == ["base", "map", "arm", "camera"]  # in order of creation
    base = tree.frame("base")
    assert (base.parent, base.authority, base.static) == ("map", "odometry", False)
    assert (base.samples, base.oldest_stamp_ns, base.newest_stamp_ns) == (2, 10 * S, 20 * S)
    assert base.rate_hz == pytest.approx(0.2)
    assert tree.frame("map").parent is None
    assert tree.frame("map").newest_stamp_ns is None
    assert tree.frame("camera").static
    assert tree.chain("arm", "camera") == ["arm", "base", "camera"]
    assert tree.chain("arm", "map", 15 * S) == ["arm", "base", "map"]
    assert tree.chain("map", "map") == ["map"]
    assert tree.parent("arm") == "base"
    assert tree.parent("map") is None
    for ask in (tree.frame, tree.parent, lambda name: tree.chain(name, "map")):
        with pytest.raises(LookupException):
            ask("nowhere")
    stats = tree.stats()
    assert (stats["frames"], stats["static_links"], stats["samples"]) == (4, 1, 4)


def test_clear_keeps_static_links_and_names(tree: TransformTree) -> None:
    tree.clear()
    assert tree.can_transform("base", "camera", 99 * S)
    assert tree.frames() == ["base", "map", "arm", "camera"]
    with pytest.raises(ConnectivityException):
        tree.lookup_transform("map", "base")
    tree.clear(keep_static=False)
    assert not tree.can_transform("base", "camera")
    tree.set_transform(link("map", "base", 1))  # older than what was cleared
    assert tree.can_transform("map", "base", 1)


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


def test_a_deep_chain() -> None:
    tree = TransformTree()
    tree.set_transforms_xact([link(f"f{i}", f"f{i + 1}", 1, 1.0) for i in range(1000)])
    assert x_of(tree.lookup_transform("f0", "f1000")) == 1000.0
    assert x_of(tree.lookup_transform("f1000", "f0")) == -1000.0


def test_no_frame_is_deeper_than_the_limit() -> None:
    tree = TransformTree(max_depth=3)
    tree.set_transforms_xact([link(f"f{i}", f"f{i + 1}", 1) for i in range(3)])
    tree.set_transform(link("top", "other", 1))
    for parent, child in (("f3", "new"), ("top", "f0")):
        with pytest.raises(LimitExceeded) as caught:
            tree.set_transform(link(parent, child, 2))
        error = caught.value
        assert (error.field, error.limit, error.value) == ("max_depth", 3, 4)
        assert (error.frame, error.parent_frame) == (child, parent)
    assert "new" not in tree.frames()
    tree.remove_frame("f3")
    assert tree.set_transform(link("top", "f0", 2))


def test_a_dropped_sample_creates_no_frame() -> None:
    tree = TransformTree(10.0, max_frames=4)
    tree.set_transform(link("map", "base", 100 * S))
    for index in range(10):
        assert not tree.set_transform(link(f"ghost{index}", "base", S))
    assert tree.frames() == ["base", "map"]
    assert tree.frame("base").dropped == 10
    tree.set_transform(link("base", "camera", 100 * S))
    tree.remove_frame("camera")
    assert not tree.set_transform(link("camera", "base", S))  # nor does one come back
    assert tree.frames() == ["base", "map"]
    full = TransformTree(10.0, max_samples_per_frame=2)
    full.set_transforms_xact([link("map", "base", 100 * S + i) for i in range(2)])
    assert not full.set_transform(link("ghost", "base", 99 * S))
    assert full.frames() == ["base", "map"]


def test_a_tree_without_a_limit_of_depths() -> None:
    tree = TransformTree(max_depth=0)
    for index in range(2000):
        tree.set_transform(link(f"f{index}", f"f{index + 1}", 10, 1.0))
    assert x_of(tree.lookup_transform("f0", "f2000")) == 2000.0
    with pytest.raises(InvalidArgumentException, match="cycle"):
        tree.set_transform(link("f2000", "f0", 10))
    tree.set_transform(link("top", "f0", 10))
    tree.set_transform(link("f1", "f0", 5))
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
    counting = TransformTree()
    for authority in ("a", "b", "a"):
        counting.set_transform(link("map", "base", 1), authority=authority)
    assert counting.frame("base").authority_changes == 2
    assert counting.frame("base").rewritten == 2


def test_names_are_any_text(tree: TransformTree) -> None:
    for name in ("größe", "机器人/手", "a b\n", "x\0y", "*", "🤖"):
        tree.set_transform(link("map", name, 15 * S, 2.0))
        assert tree.lookup_transform("map", name).child_frame == name
    with pytest.raises(InvalidArgumentException):
        tree.lookup_transform("map", "\ud800")


def test_one_name_gets_one_frame(tree: TransformTree) -> None:
    barrier = threading.Barrier(4)

    def create(worker: int) -> None:
        barrier.wait()
        for i in range(500):
            tree.set_transform(link("map", f"n{i}", 15 * S + worker))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(create, range(4)))
    assert len(tree.frames()) == len(set(tree.frames())) == 504


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
