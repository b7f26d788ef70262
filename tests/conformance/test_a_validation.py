"""A: what a set rejects.

[Q] Decision for A01 to A05 and A07: where tf2 returns False, an InvalidArgumentException says
what is wrong and for which frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from zenoh_tf import InvalidArgumentException

from .shorthand import NO_ROTATION, ORIGIN, Tree, assert_pose, can, look, ns, put, put_ns, stamped

NAN = math.nan
INF = math.inf


def test_A01_no_insert_on_self_transform(tf: Tree) -> None:
    """A frame cannot be its own parent, with or without a leading slash."""
    for parent, child in (("same_frame", "same_frame"), ("/same_frame", "same_frame")):
        with pytest.raises(InvalidArgumentException) as refused:
            put(tf, parent, child, 10)
        assert refused.value.frame == refused.value.parent_frame == "same_frame"
    assert tf.frames() == []


def test_A02_no_insert_with_nan(tf: Tree) -> None:
    """A NaN in translation or rotation is rejected, and changes nothing."""
    assert put(tf, "same_frame", "other_frame", 10, (1, 2, 3))
    bad = [
        ("translation", (NAN, 0, 0), NO_ROTATION),
        ("translation", (0, 0, NAN), NO_ROTATION),
        ("rotation", ORIGIN, (0, 0, 0, NAN)),
        ("rotation", ORIGIN, (NAN, 0, 0, 1)),
    ]
    for field, xyz, q in bad:
        with pytest.raises(InvalidArgumentException) as refused:
            put(tf, "same_frame", "other_frame", 10, xyz, q)
        assert refused.value.field == field
        assert refused.value.frame == "other_frame"
        assert refused.value.parent_frame == "same_frame"
    assert_pose(look(tf, "same_frame", "other_frame", 10), (1, 2, 3))
    assert tf.frame("other_frame").samples == 1


def test_A03_no_insert_with_no_frame_id(tf: Tree) -> None:
    """A child needs a name; one leading slash is not a name."""
    for child in ("", "/"):
        with pytest.raises(InvalidArgumentException) as refused:
            put(tf, "same_frame", child, 10)
        assert refused.value.field == "child_frame"
        assert refused.value.parent_frame == "same_frame"
    assert tf.frames() == []


def test_A04_no_insert_with_no_parent_id(tf: Tree) -> None:
    """A parent needs a name; one leading slash is not a name."""
    for parent in ("", "/"):
        with pytest.raises(InvalidArgumentException) as refused:
            put(tf, parent, "some_frame", 10)
        assert refused.value.field == "parent_frame"
        assert refused.value.frame == "some_frame"
    assert tf.frames() == []


def test_A05_set_transform_fail(tf: Tree) -> None:
    """An empty message, with both names empty, is rejected."""
    with pytest.raises(InvalidArgumentException):
        put(tf, "", "", 0)
    assert tf.frames() == []


def test_A06_set_transform_valid(tf: Tree) -> None:
    """A valid transform is stored, and the call returns True."""
    assert put(tf, "foo", "child", 1) is True
    assert can(tf, "foo", "child", 1)


def test_A07_set_transform_invalid_quaternion(tf: Tree) -> None:
    """A quaternion of zeros is rejected."""
    with pytest.raises(InvalidArgumentException) as refused:
        put(tf, "foo", "child", 1, ORIGIN, (0, 0, 0, 0))
    assert refused.value.field == "rotation"
    assert (refused.value.parent_frame, refused.value.frame) == ("foo", "child")
    assert tf.frames() == []


def test_A08_quaternion_norm(tf: Tree) -> None:
    """[Q] Decision A08: a squared norm that differs from 1 by 0.01 or more is rejected; others are
    normalised. tf2 0.39.1 normalises whatever is not zero."""
    for w in (2.0, 0.5, 1e-3, math.sqrt(1.0101), math.sqrt(0.9899)):
        with pytest.raises(InvalidArgumentException) as refused:
            put(tf, "foo", "child", 1, ORIGIN, (0, 0, 0, w))
        assert refused.value.field == "rotation"
    assert tf.frames() == []
    half = math.sqrt(0.5)
    for seconds, norm2 in enumerate((1.0099, 0.9901), start=1):
        part = half * math.sqrt(norm2)
        assert put(tf, "foo", "child", seconds, ORIGIN, (0, 0, part, part))
        answer = look(tf, "foo", "child", seconds)
        assert_pose(answer, ORIGIN, (0, 0, half, half), tolerance=1e-12)


def test_A08b_no_insert_with_infinity(tf: Tree) -> None:
    """[Q] Decision A08b: infinity is rejected like NaN; tf2 stores it."""
    for bad in (INF, -INF):
        with pytest.raises(InvalidArgumentException) as translation:
            put(tf, "foo", "child", 1, (bad, 0, 0))
        assert translation.value.field == "translation"
        with pytest.raises(InvalidArgumentException) as rotation:
            put(tf, "foo", "child", 1, ORIGIN, (0, 0, 0, bad))
        assert rotation.value.field == "rotation"
    assert tf.frames() == []


def test_A09_leading_slash(tf: Tree) -> None:
    """[Q] Decision A09: a set strips one leading slash; a lookup rejects it and names the
    spelling without. A set refuses a name of two, which tf2 stores with one, and cannot look up."""
    assert put(tf, "/p", "/c", 1)
    assert sorted(tf.frames()) == ["c", "p"]
    assert look(tf, "p", "c", 1).parent_frame == "p"
    for target, source, spelling in (("/p", "c", "'p'"), ("p", "/c", "'c'")):
        with pytest.raises(InvalidArgumentException, match=f"is spelled {spelling}"):
            look(tf, target, source, 1)
    for parent, child in (("//q", "d"), ("q", "//d")):
        with pytest.raises(InvalidArgumentException, match="more than one '/'"):
            put(tf, parent, child, 1)
    assert sorted(tf.frames()) == ["c", "p"]


@pytest.mark.own_server
def test_A10_old_data(tf: Tree) -> None:
    """[Q] Decision A10: a row older than newest - cache time is dropped, counted, and the return
    value says so. It creates no frame, while tf2 creates its parent. Inside a transaction it
    rejects the whole, and nothing is written."""
    assert put(tf, "p", "c", 100, (100, 0, 0))
    assert put(tf, "p", "c", 90, (90, 0, 0)) is True
    assert_pose(look(tf, "p", "c", 90), (90, 0, 0))
    assert put_ns(tf, "p", "c", ns(90) - 1) is False
    assert tf.frame("c").dropped == 1
    assert put_ns(tf, "ghost", "c", ns(90) - 1) is False
    assert sorted(tf.frames()) == ["c", "p"]
    with pytest.raises(InvalidArgumentException) as refused:
        tf.set_transforms_xact([stamped("p", "other", 95), stamped("p", "c", 89)])
    assert (refused.value.frame, refused.value.stamp_ns) == ("c", ns(89))
    assert "other" not in tf.frames()
    assert tf.frame("c").samples == 2


@pytest.mark.parametrize("wrong", [None, 3, b"map"])
def test_A11_what_is_no_name_is_named(tf: Tree, wrong: Any) -> None:
    """Also Python's own TypeError, as of tf2."""
    put(tf, "map", "base", 1.0)
    calls: list[tuple[str, Callable[[], object]]] = [
        ("target_frame", lambda: tf.lookup_transform(wrong, "base")),
        ("source_frame", lambda: tf.lookup_latest_transform("map", wrong)),
        ("fixed_frame", lambda: tf.lookup_transform_full("map", None, "base", None, wrong)),
        ("tracking_frame", lambda: tf.lookup_velocity(wrong, "map")),
        ("target_frame", lambda: tf.explain(wrong, "base")),
        ("frame", lambda: tf.frame(wrong)),
        ("frame", lambda: tf.parent(wrong)),
        ("source_frame", lambda: tf.chain("map", wrong)),
        ("name", lambda: tf.remove_frame(wrong)),
    ]
    for field, call in calls:
        with pytest.raises(InvalidArgumentException, match=f"^{field} must be a str, not") as error:
            call()
        assert error.value.field == field
        assert isinstance(error.value, TypeError)
