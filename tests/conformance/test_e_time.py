"""E: which times have answers, and what "latest" means."""

from __future__ import annotations

import pytest

from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    LookupException,
    NoDataForExtrapolationException,
    TransformException,
)

from .shorthand import ORIGIN, Tree, assert_pose, can, look, ns, put, put_ns, x_of

#: E06 to E08: no time given, then before, within and after the samples of `siblings`.
ZERO, OLD, VALID, FUTURE = None, 5, 15, 25
ALL_TIMES = (ZERO, OLD, VALID, FUTURE)
MATRIX = {ZERO: True, OLD: False, VALID: True, FUTURE: False}


def siblings(tf: Tree) -> None:
    """Two children of one parent, a sample each second from 10 s to 19 s."""
    for seconds in range(10, 20):
        put(tf, "parent", "child", seconds, (1, 0, 0))
        put(tf, "parent", "other_child", seconds, (0, 1, 0))


def can_full(
    tf: Tree, target: str, target_s: float | None, source: str, source_s: float | None, fixed: str
) -> bool:
    """Whether the lookup through a fixed frame has an answer."""
    times = [None if seconds is None else ns(seconds) for seconds in (target_s, source_s)]
    try:
        tf.lookup_transform_full(target, times[0], source, times[1], fixed)
    except ExtrapolationException:
        return False
    return True


def test_E01_latest_common_time(tf: Tree) -> None:
    """The newest time that every link between two frames has reached."""
    put_ns(tf, "parent", "a", 1000)
    put_ns(tf, "pp", "parent", 2000)
    assert tf.latest_common_time("a", "pp") == 1000
    with pytest.raises(LookupException):
        tf.latest_common_time("a", "unknown")
    put_ns(tf, "parent", "a", 3000)
    assert tf.latest_common_time("a", "pp") == 2000
    put_ns(tf, "parent", "b", 4000)
    put_ns(tf, "b", "c", 3000)
    put_ns(tf, "c", "d", 9000)
    put_ns(tf, "f", "e", 5000)
    for one, other in ("ab", "ac", "ca", "ad", "da"):
        assert tf.latest_common_time(one, other) == 3000
    assert tf.latest_common_time("e", "f") == tf.latest_common_time("f", "e") == 5000
    with pytest.raises(ConnectivityException):
        tf.latest_common_time("a", "e")
    assert tf.latest_common_time("a", "a") == 3000
    for seconds in (0, 1, 0.5):
        put(tf, "x", "y", seconds)
    assert tf.latest_common_time("x", "y") == ns(1)


def test_E02_no_extrapolation_from_parent(tf: Tree) -> None:
    """A time between the samples of all links is no extrapolation."""
    for stamp_ns in (1000, 10_000):
        for parent, child in (
            ("parent", "a"),
            ("parent", "b"),
            ("pp", "parent"),
            ("ppp", "pp"),
        ):
            put_ns(tf, parent, child, stamp_ns)
    assert_pose(tf.lookup_transform("b", "a", 2000), ORIGIN)
    assert_pose(tf.lookup_transform("ppp", "a", 2000), ORIGIN)


def test_E03_extrapolation_from_one_value(tf: Tree) -> None:
    """One sample alone answers at its own stamp only."""
    put_ns(tf, "parent", "a", 1000)
    put_ns(tf, "pp", "parent", 1000)
    for target, stamp_ns in (("parent", 10), ("parent", 100_000), ("pp", 1), ("pp", 10_000)):
        with pytest.raises(NoDataForExtrapolationException) as error:
            tf.lookup_transform(target, "a", stamp_ns)
        assert error.value.stamp_ns == stamp_ns
        assert error.value.oldest_stamp_ns == error.value.newest_stamp_ns == 1000
    assert tf.lookup_transform("pp", "a", 1000).stamp_ns == 1000
    put_ns(tf, "parent", "a", 20_000)
    assert tf.lookup_transform("parent", "a", 10_000).stamp_ns == 10_000


def test_E04_exceptions(tf: Tree) -> None:
    """Unknown frame, single sample, before the oldest, after the newest: each has its own error."""
    both = (("parent", "me"), ("me", "parent"))
    assert not tf.can_transform("parent", "me", 10_000_000)
    with pytest.raises(LookupException):
        tf.lookup_transform("parent", "me", 10_000_000)
    put_ns(tf, "parent", "me", 100_000)
    for target, source in both:
        with pytest.raises(NoDataForExtrapolationException):
            tf.lookup_transform(target, source, 200_000)
    put_ns(tf, "parent", "me", 300_000)
    for target, source in both:
        assert tf.lookup_transform(target, source, 200_000).stamp_ns == 200_000
        with pytest.raises(BackwardExtrapolationException):
            tf.lookup_transform(target, source, 1000)
        with pytest.raises(ForwardExtrapolationException):
            tf.lookup_transform(target, source, 350_000)


def test_E05_backward_and_forward(tf: Tree) -> None:
    """Each extrapolation error has its own class, and its bases are tf2's."""
    put(tf, "foo", "bar", 2)
    assert can(tf, "foo", "bar", 2)
    for seconds in (4, 1):
        with pytest.raises(NoDataForExtrapolationException):
            look(tf, "foo", "bar", seconds)
    put(tf, "foo", "bar", 3)
    for seconds, kind in (
        (1, BackwardExtrapolationException),
        (4, ForwardExtrapolationException),
    ):
        assert not can(tf, "foo", "bar", seconds)
        with pytest.raises(kind) as error:
            look(tf, "foo", "bar", seconds)
        facts = error.value
        assert (facts.frame, facts.parent_frame, facts.stamp_ns) == ("bar", "foo", ns(seconds))
        assert (facts.target_frame, facts.source_frame) == ("foo", "bar")
        assert (facts.oldest_stamp_ns, facts.newest_stamp_ns) == (ns(2), ns(3))
    for missing in (
        NoDataForExtrapolationException,
        BackwardExtrapolationException,
        ForwardExtrapolationException,
    ):
        assert issubclass(missing, ExtrapolationException)
    assert issubclass(ExtrapolationException, TransformException)


def test_E06_can_transform(tf: Tree) -> None:
    """True within the samples and without a time, False before and after; always True for a known
    frame in itself. [Q] Decision E06: an unknown frame to itself is not possible, in tf2 it is."""
    siblings(tf)
    for target, source in (("child", "parent"), ("child", "other_child")):
        assert {seconds: can(tf, target, source, seconds) for seconds in ALL_TIMES} == MATRIX
    for seconds in ALL_TIMES:
        assert can(tf, "child", "child", seconds)
        assert can(tf, "parent", "parent", seconds)
        assert not can(tf, "some_frame", "some_frame", seconds)


def test_E07_can_transform_full(tf: Tree) -> None:
    """Each leg is checked at its own time; a leg without links has an answer at any time."""
    siblings(tf)
    for source in ("parent", "other_child"):
        for seconds in ALL_TIMES:
            assert can_full(tf, "child", seconds, source, VALID, "child")
        for seconds in (OLD, FUTURE):
            assert not can_full(tf, "child", VALID, source, seconds, "child")
    for seconds in ALL_TIMES:
        assert can_full(tf, "child", seconds, "parent", VALID, "parent") is MATRIX[seconds]
        assert can_full(tf, "child", VALID, "parent", seconds, "parent")


def test_E08_lookup_transform(tf: Tree) -> None:
    """The lookup answers where can_transform says so, stamped with the time asked for. [Q]
    Decision E08: an unknown frame to itself is a LookupException, in tf2 the identity."""
    siblings(tf)
    for target, source, xyz in (
        ("child", "parent", (-1, 0, 0)),
        ("child", "other_child", (-1, 1, 0)),
    ):
        for seconds in (ZERO, VALID):
            answer = look(tf, target, source, seconds)
            assert_pose(answer, xyz)
            assert answer.stamp_ns == ns(19 if seconds is None else seconds)
            assert (answer.parent_frame, answer.child_frame) == (target, source)
        with pytest.raises(BackwardExtrapolationException):
            look(tf, target, source, OLD)
        with pytest.raises(ForwardExtrapolationException):
            look(tf, target, source, FUTURE)
    for seconds in (OLD, VALID, FUTURE):
        same = look(tf, "child", "child", seconds)
        assert_pose(same, ORIGIN)
        assert same.stamp_ns == ns(seconds)
    assert look(tf, "child", "child").stamp_ns == ns(19)
    for at in ALL_TIMES:
        with pytest.raises(LookupException) as unknown:
            look(tf, "some_frame", "some_frame", at)
        assert unknown.value.frame == "some_frame"
    with pytest.raises(LookupException):
        tf.lookup_transform_full("nope", ns(VALID), "nope", ns(VALID), "nope")


def test_E09_only_links_below_the_common_ancestor(tf: Tree) -> None:
    """Links above the common ancestor of two frames do not matter."""
    for seconds in (10, 12):
        put(tf, "base", "l", seconds, (1, 0, 0))
        put(tf, "base", "r", seconds, (-1, 0, 0))
    put(tf, "map", "base", 5)
    assert_pose(look(tf, "l", "r", 11), (-2, 0, 0))
    assert look(tf, "l", "r").stamp_ns == ns(12)
    with pytest.raises(NoDataForExtrapolationException):
        look(tf, "map", "r", 11)


def test_E10_latest_can_fail(tf: Tree) -> None:
    """[Q] No link of one sample reaches back to the latest common time, so that lookup fails as
    tf2's does; the latest lookups, each link at its own newest, answer."""
    put_ns(tf, "parent", "a", 3000, (1, 0, 0))
    put_ns(tf, "parent", "b", 4000, (3, 0, 0))
    assert tf.latest_common_time("a", "b") == 3000
    with pytest.raises(NoDataForExtrapolationException):
        look(tf, "a", "b")
    for newest in (tf.lookup_latest_transform("a", "b"), tf.lookup_latest_transform_xact("a", "b")):
        assert_pose(newest, (2, 0, 0))
        assert (newest.stamp_ns, newest.newest_stamp_ns) == (3000, 4000)
    put_ns(tf, "parent", "b", 2000, (1, 0, 0))
    common = look(tf, "a", "b")
    assert_pose(common, (1, 0, 0))
    assert common.stamp_ns == 3000


def test_E11_stamp_precision(tf: Tree) -> None:
    """Stamps keep full nanosecond precision, however large they are."""
    stamp_ns = 1_000_000_000 * 1_000_000_000 + 1
    put_ns(tf, "parent", "child", stamp_ns)
    assert look(tf, "parent", "child").stamp_ns == stamp_ns
    assert tf.lookup_transform("parent", "child", stamp_ns).stamp_ns == stamp_ns
    for other_ns in (stamp_ns - 1, stamp_ns + 1):
        with pytest.raises(NoDataForExtrapolationException):
            tf.lookup_transform("parent", "child", other_ns)


def test_E12_stamp_zero(tf: Tree) -> None:
    """[Q] Decision E12: stamp 0 is an ordinary time, and None means the latest. In tf2 0 means
    both, and is ignored in the latest common time."""
    put(tf, "parent", "a", 0, (1, 0, 0))
    put(tf, "parent", "b", 5, (2, 0, 0))
    assert tf.latest_common_time("a", "b") == 0
    assert tf.latest_common_time("a", "a") == 0
    put(tf, "parent", "a", 5, (3, 0, 0))
    assert x_of(look(tf, "parent", "a", 0)) == 1.0
    assert x_of(look(tf, "parent", "a")) == 3.0
    assert tf.latest_common_time("a", "b") == ns(5)
