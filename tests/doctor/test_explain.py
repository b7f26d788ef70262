"""`explain`: the chain link by link, the limiting link, and sentences that help."""

from __future__ import annotations

from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.support.recorded import needs_recording, questions, transforms
from tests.support.runs import CONTROLS
from zenoh_tf import (
    Explanation,
    InvalidArgumentException,
    StampedTransform,
    Transform,
    TransformException,
    TransformTree,
)
from zenoh_tf._core import similar_names
from zenoh_tf.text.similar import did_you_mean

S = 10**9
NOW_NS = 1_700_000_000 * S


def put(
    tree: Any, parent: str, child: str, *stamps_s: float, authority: str = "", static: bool = False
) -> None:
    for stamp_s in stamps_s:
        stamped = StampedTransform(parent, child, NOW_NS + round(stamp_s * S), Transform((1, 0, 0)))
        tree.set_transform(stamped, authority=authority, static=static)


@pytest.fixture
def tree() -> TransformTree:
    """map -> odom (slow) -> base (fast) -> camera (static); base -> arm has one sample."""
    tree = TransformTree()
    put(tree, "map", "odom", *range(10), authority="amcl")
    put(tree, "odom", "base", *(n / 10 for n in range(100)), authority="wheels")
    put(tree, "base", "camera", 0, authority="mounts", static=True)
    put(tree, "base", "arm", 8, authority="driver")
    return tree


def explained(
    tree: TransformTree, target: str, source: str, at_s: float | None = None, now_s: float = 10
) -> Explanation:
    """As `tree.explain`, at a time of the test's choice."""
    stamp_ns = None if at_s is None else NOW_NS + round(at_s * S)
    found = tree.explain(target, source, stamp_ns)
    at_now = tree._explain(target, source, stamp_ns, NOW_NS + round(now_s * S))
    assert (found.possible, found.error, found.limiting_frame) == (
        at_now.possible,
        at_now.error,
        at_now.limiting_frame,
    )
    return at_now


def test_the_latest_common_time_and_what_limits_it(tree: TransformTree) -> None:
    found = explained(tree, "map", "camera")
    assert (found.possible, found.error, found.at_ns) == (True, None, NOW_NS + 9 * S)
    assert found.limiting_frame == "odom"
    assert [(link.parent, link.child) for link in found.links] == [
        ("map", "odom"),
        ("odom", "base"),
        ("base", "camera"),
    ]
    odom, base, camera = found.links
    assert (odom.authority, odom.age_s, odom.stopped) == ("amcl", 1.0, False)
    assert base.rate_hz == pytest.approx(10.1, abs=0.01)
    assert (camera.static, camera.age_s, camera.problem) == (True, None, None)
    assert found.reasons == (
        "The lookup succeeds at 1700000009.000000000 s, 1.0 s ago.",
        "'map' -> 'odom' limits the latest common time: all others reach 900 ms further, or more.",
    )
    assert "zenoh-tf latest" in found.advice[-1]
    text = str(found)
    assert text.splitlines()[0] == "camera in map at the latest common time"
    assert "map -> odom" in text and "<- ends first" in text


def test_a_time_that_is_too_new(tree: TransformTree) -> None:
    found = explained(tree, "map", "camera", 9.4)
    assert (found.error, found.limiting_frame) == ("ForwardExtrapolationException", "odom")
    assert [(link.problem, link.off_by_ns) for link in found.links] == [
        ("too_new", 4 * S // 10),
        (None, None),
        (None, None),
    ]
    assert found.reasons == (
        "1700000009.400000000 s is 400 ms after the newest sample of 'map' -> 'odom'.",
    )
    assert "time-out" in found.advice[0]
    assert "<- ends 400 ms before" in str(found)


def test_a_time_that_is_too_old(tree: TransformTree) -> None:
    found = explained(tree, "map", "camera", -3)
    assert (found.error, found.limiting_frame) == ("BackwardExtrapolationException", "odom")
    assert "3.0 s before the oldest sample of 'map' -> 'odom'" in found.reasons[0]
    assert "history of 9.0 s" in found.advice[0]


def test_a_time_ahead_of_the_clock(tree: TransformTree) -> None:
    found = explained(tree, "odom", "base", 12, now_s=10)
    assert found.error == "ForwardExtrapolationException"
    assert "2.0 s ahead of this machine's clock" in found.advice[0]


@pytest.mark.parametrize("at_s", [-1e9, 1e8])
def test_a_time_of_another_clock(tree: TransformTree, at_s: float) -> None:
    """The classic: simulated transforms, and the time of the machine, or the reverse."""
    found = explained(tree, "map", "camera", at_s)
    (advice,) = found.advice
    assert "are of different clocks" in advice


def test_a_single_sample(tree: TransformTree) -> None:
    assert explained(tree, "base", "arm").possible
    found = explained(tree, "base", "arm", 8.5)
    assert (found.error, found.limiting_frame) == ("NoDataForExtrapolationException", "arm")
    assert "a single sample, and 1700000008.500000000 s is 500 ms off it" in found.reasons[0]
    assert "publish the link as static" in found.advice[0]
    # tf2's classic failure at the start: no time suits both links.
    put(tree, "base", "gripper", 8.2)
    found = explained(tree, "gripper", "arm")
    assert (found.error, found.limiting_frame) == ("NoDataForExtrapolationException", "arm")
    assert found.reasons[0].startswith("The latest common time is 1700000008.000000000 s, where")


def test_a_link_that_has_stopped(tree: TransformTree) -> None:
    found = explained(tree, "map", "camera", now_s=40)
    assert [link.stopped for link in found.links] == [True, True, False]
    assert (
        "'map' -> 'odom' has stopped: its newest sample is 31.0 s old, and before that they came "
        "at 1.1 Hz."
    ) in found.reasons
    assert "Check that 'amcl' runs" in found.advice[0]
    assert "stopped" in str(found)


def test_stamps_of_another_clock_have_ages_beside_the_newest(tree: TransformTree) -> None:
    found = explained(tree, "map", "camera", now_s=10**7)
    assert not found.by_clock
    assert [link.age_s for link in found.links] == [0.9, 0.0, None]
    assert not any(link.stopped for link in found.links)
    assert found.reasons[0] == "The lookup succeeds at 1700000009.000000000 s."


def test_no_time_suits_two_links() -> None:
    tree = TransformTree()
    put(tree, "map", "left", 0, 1)
    put(tree, "map", "right", 4, 5)
    found = explained(tree, "left", "right", 3)
    assert {link.problem for link in found.links} == {"too_new", "too_old"}
    assert found.limiting_frame == "left"
    assert found.reasons[-1] == "No time around it suits all links."


@pytest.mark.parametrize(
    ("name", "question"),
    [
        ("Camera", "Did you mean 'camera'?"),
        ("cam/era", "Did you mean 'camera'?"),
        ("robot1/camera", "Did you mean 'camera'?"),
        ("camrea", "Did you mean 'camera'?"),
        ("zzz", "None of the tree's 5 frames has a name like it."),
    ],
)
def test_an_unknown_frame(tree: TransformTree, name: str, question: str) -> None:
    found = explained(tree, "map", name)
    assert (found.error, found.links) == ("LookupException", ())
    assert (found.target_root, found.source_root) == ("map", None)
    assert found.reasons == (f"Frame {name!r} does not exist.",)
    assert question in found.advice[0]


def test_an_empty_tree() -> None:
    found = explained(TransformTree(), "map", "map")
    assert found.reasons[-1] == "The tree has no frames: nothing has been published to it."


def test_trees_that_are_not_connected(tree: TransformTree) -> None:
    put(tree, "Base", "tool", 1)
    found = explained(tree, "map", "tool")
    assert (found.error, found.limiting_frame) == ("ConnectivityException", None)
    assert (found.target_root, found.source_root) == ("map", "Base")
    assert found.reasons == (
        "'map' and 'tool' are not connected: their roots are 'map' and 'Base'.",
    )
    assert found.advice[0].endswith("two spellings of one name: did you mean 'base'?")


def test_static_links_and_a_frame_in_itself(tree: TransformTree) -> None:
    found = explained(tree, "camera", "base")
    assert (found.possible, found.at_ns, found.limiting_frame) == (True, None, None)
    (reason,) = found.reasons
    assert reason == "The lookup succeeds. All links are static, so it does for every time."
    assert explained(tree, "arm", "arm", 99).possible


def test_the_parents_are_those_of_the_time() -> None:
    tree = TransformTree()
    put(tree, "map", "table", 0, 9)
    put(tree, "map", "gripper", 0, 9)
    put(tree, "table", "cup", 0, 1, 2)
    put(tree, "gripper", "cup", 5, 6, 7)
    assert [link.child for link in tree.explain("map", "cup", NOW_NS + S).links] == ["table", "cup"]
    assert [link.child for link in tree.explain("map", "cup").links] == ["gripper", "cup"]
    # Where it has no data, the newest parent stands.
    late = tree.explain("map", "cup", NOW_NS + 8 * S)
    assert [link.parent for link in late.links] == ["map", "gripper"]


@pytest.mark.parametrize("names", [("", "a"), ("a", "/b"), ("a", 3)])
def test_names_that_no_frame_can_have(tree: TransformTree, names: Any) -> None:
    with pytest.raises(InvalidArgumentException):
        tree.explain(*names)


def test_the_document_is_json(tree: TransformTree) -> None:
    document = tree.explain("map", "camera").document()
    assert document["links"][0]["child"] == "odom"
    assert document["limiting_frame"] == "odom"


def test_names_that_are_alike() -> None:
    names = ["base_link", "base_footprint", "robot2/base_link", "Base_Link", "laser"]
    assert similar_names("base_link", names) == ["Base_Link", "robot2/base_link", "base_footprint"]
    assert similar_names("robot1/base_link", names)[0] == "base_link"
    assert did_you_mean("lase", names) == "did you mean 'laser'?"
    assert did_you_mean("wheel", names) is None
    assert did_you_mean("x", []) is None
    assert (
        did_you_mean(["odom", "lase"], ["robot1/odom", "robot2/odom", "laser"])
        == "did you mean 'robot1/odom' or 'robot2/odom' instead of 'odom', and 'laser' instead of "
        "'lase'?"
    )
    assert did_you_mean(["zzz", "lase"], names) == "did you mean 'laser' instead of 'lase'?"
    assert did_you_mean([], names) is None


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_it_is_of_one_instant(concurrency: Any) -> None:
    """A transaction moves both links at once: their newest stamps are never seen apart."""
    tree = TransformTree(concurrency=concurrency)
    put(tree, "map", "a", 0)
    put(tree, "map", "b", 0)

    def write() -> None:
        for n in range(1, 3000):
            rows = [StampedTransform("map", f, NOW_NS + n, Transform()) for f in "ab"]
            tree.set_transforms_xact(rows)

    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(write)
        while not writing.done():
            found = tree.explain("a", "b")
            assert len({link.newest_stamp_ns for link in found.links}) == 1
            assert found.possible
        writing.result()


@needs_recording
def test_it_names_the_limiting_link_of_the_recorded_questions() -> None:
    """Against the recording itself: the chain, and the stamps of each of its links."""
    tree = TransformTree(cache_time_s=1000.0)
    parents: dict[str, str] = {}
    stamps: dict[str, set[int]] = defaultdict(set)
    for static, stampeds in transforms():
        for stamped in stampeds:
            tree.set_transform(stamped, static=static)
            parents[stamped.child_frame] = stamped.parent_frame
            if not static:
                stamps[stamped.child_frame].add(stamped.stamp_ns)

    def ancestors(frame: str) -> list[str]:
        return [frame, *ancestors(parents[frame])] if frame in parents else [frame]

    named = 0
    for question in (q for q in questions() if q.fixed_frame is None):
        found = tree.explain(question.target, question.source, question.stamp_ns)
        assert found.possible == (question.error is None), question
        known = all(n in parents or n in parents.values() for n in (found.target, found.source))
        if question.error is None:
            assert found.at_ns in (None, question.result_stamp_ns)
            continue
        if not known:
            assert found.error == question.error == "LookupException"
            continue
        up, down = ancestors(question.source), ancestors(question.target)
        chain = [f for f in stamps if (f in up) != (f in down)]
        at_ns = question.stamp_ns
        assert at_ns is not None
        off = {f: max(at_ns - max(stamps[f]), min(stamps[f]) - at_ns) for f in chain}
        assert found.limiting_frame == max(off, key=lambda f: off[f]), question
        failing = {link.child: link.off_by_ns for link in found.links if link.problem}
        assert failing == {f: by for f, by in off.items() if by > 0}
        with pytest.raises(TransformException) as caught:
            tree.lookup_transform(question.target, question.source, question.stamp_ns)
        assert found.error == type(caught.value).__name__
        named += 1
    assert named > 5
