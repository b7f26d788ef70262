"""F: which error a lookup raises, and what it says."""

from __future__ import annotations

import time

import pytest

from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    NoDataForExtrapolationException,
    TimeoutException,
    TransformException,
)
from zenoh_tf_server.limits import Limits

from .conftest import MakeTree
from .shorthand import Tree, can, look, ns, put, stamped, x_of

MAX_DEPTH = 1000  # tf2's, and the default here


def test_F01_nothing_exists(tf: Tree) -> None:
    """In an empty tree a lookup raises LookupException, and can_transform returns False."""
    for seconds in (None, 0, 1):
        with pytest.raises(LookupException) as caught:
            look(tf, "foo", "bar", seconds)
        assert caught.value.frame in {"foo", "bar"}
        assert not can(tf, "foo", "bar", seconds)


def test_F02_one_of_two_frames_exists(tf: Tree) -> None:
    """An unknown frame raises LookupException, which names it, whichever of the two it is."""
    put(tf, "foo", "child", 1)
    for pair in (("foo", "bar"), ("bar", "foo")):
        for seconds in (None, 1):
            with pytest.raises(LookupException) as caught:
                look(tf, *pair, seconds)
            assert caught.value.frame == "bar"
            assert not can(tf, *pair, seconds)
    assert sorted(tf.frames()) == ["child", "foo"]  # a lookup creates no frame


def test_F03_two_trees(tf: Tree) -> None:
    """Two known frames without a common ancestor: ConnectivityException, which names the roots."""
    put(tf, "a", "b", 1)
    put(tf, "b", "c", 1)
    put(tf, "d", "e", 1)
    for seconds in (None, 1):
        with pytest.raises(ConnectivityException) as caught:
            look(tf, "c", "e", seconds)
        facts = caught.value.facts
        assert (facts["target_frame"], facts["source_frame"]) == ("c", "e")
        assert (facts["target_root"], facts["source_root"]) == ("a", "d")
        assert facts.get("stamp_ns") == (None if seconds is None else ns(seconds))
        assert not can(tf, "c", "e", seconds)


INVALID = (("", "a"), ("b", ""), ("/b", "a"), ("b", "/a"))


def test_F04_lookup_of_invalid_names(tf: Tree) -> None:
    """Empty names and names with a leading slash are InvalidArgumentException.
    [Q] Decision A09: the error of a slash gives the spelling without it."""
    put(tf, "a", "b", 1)
    put(tf, "b", "c", 1)
    look(tf, "b", "a")
    for target, source in INVALID:
        for seconds in (None, 1):
            with pytest.raises(InvalidArgumentException) as caught:
                look(tf, target, source, seconds)
            at_fault = "target_frame" if target in ("", "/b") else "source_frame"
            assert caught.value.field == at_fault
            for name in (target, source):
                if name.startswith("/"):
                    assert f"'{name[1:]}'" in str(caught.value)


def test_F05_can_transform_of_invalid_names(tf: Tree) -> None:
    """can_transform answers False to names that no frame can have, and raises nothing."""
    put(tf, "a", "b", 1)
    put(tf, "b", "c", 1)
    assert tf.can_transform("b", "a") is True
    for target, source in INVALID:
        assert tf.can_transform(target, source) is False
        assert tf.can_transform(target, source, ns(1)) is False


def test_F06_extrapolation_says_which_way(tf: Tree) -> None:
    """Outside the samples: False, and the error gives the direction, the link and its range. The
    link is that of the requested time, not the newest one."""
    put(tf, "bar", "foo", 1)
    put(tf, "bar", "foo", 2)
    assert can(tf, "bar", "foo", 1.5)
    assert not can(tf, "bar", "foo", 2.5)
    with pytest.raises(ForwardExtrapolationException, match="into the future") as future:
        look(tf, "bar", "foo", 2.5)
    assert not can(tf, "bar", "foo", 0.5)
    with pytest.raises(BackwardExtrapolationException, match="into the past") as past:
        look(tf, "bar", "foo", 0.5)
    for error, asked_s in ((future.value, 2.5), (past.value, 0.5)):
        assert (error.parent_frame, error.frame, error.stamp_ns) == ("bar", "foo", ns(asked_s))
        assert (error.oldest_stamp_ns, error.newest_stamp_ns) == (ns(1), ns(2))

    put(tf, "map", "old", 8)
    put(tf, "map", "old", 9)
    for seconds in (8, 9, 10, 11):
        put(tf, "old", "c", seconds)
    put(tf, "map", "new", 20)
    put(tf, "new", "c", 12)
    with pytest.raises(ForwardExtrapolationException) as caught:
        look(tf, "map", "c", 10)
    error = caught.value
    assert (error.parent_frame, error.frame, error.stamp_ns) == ("map", "old", ns(10))
    assert (error.oldest_stamp_ns, error.newest_stamp_ns) == (ns(8), ns(9))
    with pytest.raises(NoDataForExtrapolationException) as no_data:
        look(tf, "map", "c", 12)
    assert (no_data.value.parent_frame, no_data.value.frame) == ("map", "new")


def check_that_a_cycle_is_refused(tf: Tree) -> None:
    put(tf, "a", "b", 1)
    put(tf, "b", "c", 1)
    put(tf, "x", "y", 1)
    for seconds in (1, 2):
        with pytest.raises(InvalidArgumentException, match="cycle"):
            put(tf, "c", "a", seconds)
        with pytest.raises(InvalidArgumentException, match="cycle"):
            tf.set_transforms_xact([stamped("x", "y", 2), stamped("c", "a", seconds)])
    assert tf.parent("a") is None
    assert tf.latest_common_time("x", "y") == ns(1)  # nothing of the rejected transaction
    look(tf, "a", "c", 1)


def check_that_a_past_cycle_is_found(tf: Tree) -> None:
    put(tf, "map", "a", 2)
    put(tf, "map", "b", 2)
    put(tf, "a", "b", 1)  # at 1 s: a -> b
    put(tf, "b", "a", 1)  # and b -> a; from 2 s on both have the parent map
    put(tf, "map", "outside", 1)
    put(tf, "map", "outside", 2)
    for pair in (("outside", "a"), ("a", "outside"), ("b", "map")):
        with pytest.raises(LookupException, match="loop"):
            look(tf, *pair, 1)
        assert not can(tf, *pair, 1)
    for pair in (("outside", "a"), ("b", "map"), ("a", "b")):
        look(tf, *pair, 2)


def check_depth(tf: Tree, limit: int) -> None:
    """0 -> 1 -> ..., one metre each, as many links as the limit allows."""
    links = [stamped(str(i), str(i + 1), 1, (1, 0, 0)) for i in range(limit + 1)]
    with pytest.raises(LimitExceeded) as refused:
        tf.set_transforms_xact(links)
    assert (refused.value.field, refused.value.limit) == ("max_depth", limit)
    tf.set_transforms_xact(links[:-1])
    assert x_of(look(tf, "0", str(limit), 1)) == pytest.approx(limit)
    assert x_of(look(tf, str(limit), "0", 1)) == pytest.approx(-limit)
    # A past link may be deeper: from 2 s on, this frame is a root's child.
    for parent, seconds in (("top", 2), ("top", 3), (str(limit), 1)):
        tf.set_transform(stamped(parent, "deep", seconds, (1, 0, 0)))
    for pair in (("0", "deep"), ("deep", "0")):
        with pytest.raises(LookupException) as caught:
            look(tf, *pair, 1)
        assert caught.value.limit == limit
        assert not can(tf, *pair, 1)


def test_F07_loops_and_depth(mode: str, make_tf: MakeTree) -> None:
    """[Q] Decision: a set that would close a cycle in the newest topology is rejected. A cycle
    at a past time only is a LookupException at that time. So is one that would put a frame more
    than max_depth links below its root; a longer path at a past time is a LookupException."""
    check_that_a_cycle_is_refused(make_tf())
    check_that_a_past_cycle_is_found(make_tf())
    check_depth(make_tf(), MAX_DEPTH)
    embedded = mode.startswith("embedded")
    check_depth(make_tf(max_depth=3) if embedded else make_tf(limits=Limits(depth=3)), 3)


def test_F08_the_error_after_waiting(tf: Tree) -> None:
    """[Q] Decision: a wait that times out raises the error of the lookup, never
    TimeoutException, and the message mentions the wait; can_transform returns False."""
    put(tf, "bar", "foo", 1)
    put(tf, "bar", "foo", 2)
    put(tf, "elsewhere", "island", 1)
    wait_s = 0.05
    cases: tuple[tuple[str, float, type[TransformException]], ...] = (
        ("nowhere", 1, LookupException),
        ("island", 1, ConnectivityException),
        ("foo", 3, ForwardExtrapolationException),
    )
    for source, seconds, kind in cases:
        begun = time.monotonic()
        with pytest.raises(kind, match="waited") as caught:
            tf.lookup_transform("bar", source, ns(seconds), timeout_s=wait_s)
        assert time.monotonic() - begun >= wait_s
        assert not isinstance(caught.value, TimeoutException)
        assert caught.value.source_frame == source
        assert tf.can_transform("bar", source, ns(seconds), timeout_s=wait_s) is False
    with pytest.raises(LookupException, match="waited"):
        tf.lookup_transform_full("bar", ns(1), "nowhere", ns(1), "bar", timeout_s=wait_s)
