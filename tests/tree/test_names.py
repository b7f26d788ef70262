"""Names of frames: each that a tree lists can be looked up and removed, and survives every copy.
Poses of links: none makes a result infinite."""

from __future__ import annotations

import math
import random

import msgpack
import pytest

from tests.support.logged_trees import Mirror, logged, state
from zenoh_tf import StampedTransform, Transform, TransformTree
from zenoh_tf._core import Changes, InterestReader, TransformRows
from zenoh_tf.errors import InvalidArgumentException

PARTS = ("/", "//", "a", "b", " ", ".", "é", "\x00", "%2F", "*", "a/b")
REFUSED = ("//a", "///a", "//", "//a/", "//é")
#: As they are given, and as they are stored.
KEPT = {"/a": "a", "a/": "a/", "a//": "a//", "a//b": "a//b", " /a": " /a", "/a//": "a//"}


def put(tree: TransformTree, name: str, x: float = 0.0, *, static: bool = False) -> None:
    tree.set_transform(StampedTransform("root", name, 1, Transform((x, 0, 0))), static=static)


@pytest.mark.parametrize("static", [False, True])
def test_one_slash_in_front_is_dropped_and_more_are_refused(static: bool) -> None:
    tree = TransformTree()
    put(tree, "a", 1, static=static)
    for name in REFUSED:
        for parent, child in (("root", name), (name, "child")):
            with pytest.raises(InvalidArgumentException, match="'/'") as caught:
                tree.set_transform(StampedTransform(parent, child, 1, Transform()), static=static)
            assert name[1:] in (caught.value.frame, caught.value.parent_frame)
        with pytest.raises(InvalidArgumentException):
            tree.lookup_transform("root", name)
    assert sorted(tree.frames()) == ["a", "root"]
    assert tree.lookup_transform("root", "a").transform.translation[0] == 1
    for given, stored in KEPT.items():
        put(tree, given, 2, static=static)
        assert tree.lookup_transform("root", stored).transform.translation[0] == 2


@pytest.mark.parametrize("name", ["/a", "//a", "///a//"])
def test_a_lookup_s_error_gives_the_spelling_without_any_slash(name: str) -> None:
    with pytest.raises(InvalidArgumentException) as caught:
        TransformTree().lookup_transform("root", name)
    assert f"is spelled '{name.lstrip('/')}'" in str(caught.value)


@pytest.mark.parametrize("seed", range(8))
def test_each_name_that_a_tree_lists_can_be_used(seed: int) -> None:
    rnd = random.Random(seed)
    tree, log = logged()
    log.start()
    interest = InterestReader(tree, [], False)
    given = {"".join(rnd.choices(PARTS, k=rnd.randint(1, 4))) for _ in range(30)}
    for name in given:
        try:
            put(tree, name, static=rnd.random() < 0.3)
        except InvalidArgumentException:
            assert name.startswith("//") or name == "/" or "\0" in name
    names = [name for name in tree.frames() if name != "root"]
    assert len(names) > 5
    by_log, by_interest = Mirror(), Mirror()
    first, last, lost, changes = log.take(1 << 20)
    assert first and not lost and changes is not None
    by_log.replay.apply(last, changes)
    seq, _, changes, _ = interest.read(False, 1 << 20)
    assert changes is not None
    by_interest.replay.apply(seq, changes)
    assert state(by_log.tree) == state(by_interest.tree) == state(tree)
    again = TransformTree()
    for name in names:
        assert not name.startswith("/")
        found = tree.lookup_transform("root", name)
        put(again, name, static=True)
        assert again.lookup_transform("root", name) is not None
        assert found.child_frame == name
        tree.remove_frame(name)
        again.remove_frame(name)
    assert tree.frames() == again.frames() == ["root"]


def test_a_mirror_refuses_names_and_poses_that_no_frame_has() -> None:
    tree, log = logged()
    log.start()
    put(tree, "a", 1)
    _, last, _, changes = log.take(1 << 20)
    assert changes is not None
    fields = msgpack.unpackb(changes)
    for form, why in (("/{}", "begins with '/'"), ("{}\0", "zero character")):
        names = [form.format(name) for name in fields["names"]]
        with pytest.raises(InvalidArgumentException, match=why):
            Mirror().replay.apply(last, msgpack.packb({**fields, "names": names}))
    pose = Changes(changes).pose.copy()
    for value in (math.inf, math.nan, 1e151):
        pose[0, 0] = value
        with pytest.raises(InvalidArgumentException, match="pose"):
            Mirror().replay.apply(last, msgpack.packb({**fields, "pose": pose.tobytes()}))
    Mirror().replay.apply(last, changes)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_translations_that_could_give_infinite_poses_are_refused(axis: int) -> None:
    tree = TransformTree()

    def put_at(parent: str, child: str, stamp: int, length: float) -> None:
        at = [0.0, 0.0, 0.0]
        at[axis] = length
        tree.set_transform(StampedTransform(parent, child, stamp, Transform(at)))

    for length in (1.001e150, -1e151, 1e300, 1.7976931348623157e308, math.inf, math.nan):
        with pytest.raises(InvalidArgumentException) as caught:
            put_at("a", "b", 1, length)
        assert (caught.value.field, caught.value.frame) == ("translation", "b")
        assert ("1e150 m" in str(caught.value)) == math.isfinite(length)
    most = 0.999e150
    for i in range(100):
        for stamp, sign in ((1_000_000_000, -1), (2_000_000_000, 1)):
            put_at(f"f{i}", f"f{i + 1}", stamp, sign * most)
    for stamp in (1_000_000_000, 1_300_000_000, 2_000_000_000):
        found = tree.lookup_transform("f0", "f100", stamp).transform.translation
        assert all(map(math.isfinite, found))
    sampled = tree.sample("f100", "f0", [1_000_000_000, 1_999_999_999])
    assert all(map(math.isfinite, sampled.poses.ravel().tolist()))


def test_a_put_of_many_rows_names_the_bad_name() -> None:
    tree = TransformTree()
    rows = TransformRows.of(
        [StampedTransform("root", name, 1, Transform()) for name in ("a", "//b", "c")]
    )
    with pytest.raises(InvalidArgumentException, match="'/b'"):
        tree._commit_rows(rows)
    assert tree.frames() == []
