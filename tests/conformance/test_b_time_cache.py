"""B: the history of one link: order, equal stamps, pruning, interpolation.

tf2's tests inspect the internal list; these observe it through `parent`, `frame` and lookups.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    NoDataForExtrapolationException,
)

from .conftest import MakeTree
from .shorthand import (
    ORIGIN,
    Tree,
    assert_pose,
    look,
    put,
    put_ns,
    rotation_error,
    x_of,
)

#: (stamp in ns, number of the parent), in order of arrival.
ARRIVALS = ((0, 0), (10, 1), (5, 2), (3, 3), (8, 4), (8, 5), (8, 6))


def arrive(tf: Tree, stamp_ns: int, parent: int) -> bool:
    return put_ns(tf, f"p{parent}", "child", stamp_ns)


def parents(tf: Tree, stamps_ns: tuple[int, ...]) -> list[str | None]:
    return [tf.parent("child", stamp_ns) for stamp_ns in stamps_ns]


def random_rotations(count: int) -> NDArray[np.float64]:
    """(count, 4) unit quaternions, evenly over all rotations."""
    q = np.random.default_rng(7).normal(size=(count, 4))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


@pytest.mark.own_server
def test_B01_order(make_tf: MakeTree) -> None:
    """Samples are ordered by time, however they arrive. [Q] Decision B12: at an equal stamp the
    last one wins; tf2 keeps all and reads the last inserted."""
    tf = make_tf(cache_time_s=10e-9)
    for stamp_ns, parent in ARRIVALS:
        assert arrive(tf, stamp_ns, parent)
    stamps_ns = (0, 3, 5, 8, 10)
    assert parents(tf, stamps_ns) == ["p0", "p3", "p2", "p6", "p1"]
    assert (tf.frame("child").samples, tf.frame("child").rewritten) == (5, 2)
    for stamp_ns, parent in reversed(ARRIVALS):
        assert arrive(tf, stamp_ns, parent)
    assert parents(tf, stamps_ns) == ["p0", "p3", "p2", "p4", "p1"]
    assert tf.frame("child").samples == 5


@pytest.mark.own_server
def test_B02_prune(make_tf: MakeTree) -> None:
    """A newer sample evicts those older than the cache time before it."""
    tf = make_tf(cache_time_s=10e-9)
    for stamp_ns, parent in ARRIVALS:
        arrive(tf, stamp_ns, parent)
    assert arrive(tf, 15, 7) is True
    assert arrive(tf, 0, 8) is False
    assert arrive(tf, 5, 9) is True
    assert parents(tf, (5, 8, 10, 15)) == ["p9", "p6", "p1", "p7"]
    info = tf.frame("child")
    assert (info.samples, info.oldest_stamp_ns, info.newest_stamp_ns) == (4, 5, 15)
    assert info.dropped == 1
    with pytest.raises(BackwardExtrapolationException):
        tf.lookup_transform("p9", "child", 4)


def test_B03_repeatability(make_tf: MakeTree) -> None:
    """Each of many samples answers at its own stamp, put in forward or in reverse."""
    for stamps_ns in (range(1, 100), range(99, -1, -1)):
        tf = make_tf()
        for stamp_ns in stamps_ns:
            assert arrive(tf, stamp_ns, stamp_ns)
        assert tf.frame("child").samples == len(stamps_ns)
        for stamp_ns in stamps_ns:
            assert tf.parent("child", stamp_ns) == f"p{stamp_ns}"
            assert tf.lookup_transform(f"p{stamp_ns}", "child", stamp_ns).stamp_ns == stamp_ns


def test_B04_repeated_elements(tf: Tree) -> None:
    """The same sample ninety-nine times is one sample."""
    for _ in range(99):
        assert put_ns(tf, "parent", "child", 1, (1, 2, 3))
    assert tf.frame("child").samples == 1
    assert_pose(look(tf, "parent", "child"), (1, 2, 3))


def test_B05_zero_at_front(tf: Tree) -> None:
    """Without a time a lookup asks for the newest. [Q] Decision E12: that is None, not stamp 0."""
    for stamp_ns in range(1, 101):
        put_ns(tf, "parent", "child", stamp_ns, (stamp_ns, 0, 0))
    assert look(tf, "parent", "child").stamp_ns == 100
    put_ns(tf, "parent", "child", 101, (101, 0, 0))
    newest = look(tf, "parent", "child")
    assert (newest.stamp_ns, x_of(newest)) == (101, 101.0)


def test_B06_cartesian_interpolation(tf: Tree) -> None:
    """Between two samples the translation is interpolated linearly."""
    random = np.random.default_rng(6)
    share = np.arange(100) / 100
    for pair in range(99):
        first, second = random.uniform(-10, 10, (2, 3))
        put_ns(tf, "parent", f"child{pair}", 200, first)
        put_ns(tf, "parent", f"child{pair}", 300, second)
        found = tf.sample("parent", f"child{pair}", 200 + np.arange(100))
        assert not found.status.any()
        expected = first + share[:, None] * (second - first)
        np.testing.assert_allclose(found.translations, expected, rtol=0, atol=2e-6)
        assert_pose(tf.lookup_transform("parent", f"child{pair}", 237), expected[37])


def test_B07_reparenting_interpolation_protection(tf: Tree) -> None:
    """Nothing is interpolated across a change of parent: the older sample holds until then."""
    q = (0.5, 0.5, 0.5, 0.5)
    put_ns(tf, "P4", "child", 555, (1, 2, 3), q)
    put_ns(tf, "P5", "child", 655, (-4, -5, -6))
    stamps_ns = np.arange(555, 655)
    found = tf.sample("P4", "child", stamps_ns)
    assert not found.status.any()
    assert (found.translations == (1, 2, 3)).all()
    assert (found.rotations == q).all()
    for stamp_ns in (555, 600, 654):
        assert tf.parent("child", stamp_ns) == "P4"
        with pytest.raises(ConnectivityException):
            tf.lookup_transform("P5", "child", stamp_ns)
    assert tf.parent("child", 655) == "P5"
    assert_pose(tf.lookup_transform("P5", "child", 655), (-4, -5, -6))


def test_B08_slerp(tf: Tree) -> None:
    """Halfway between two rotations is as far from the one as from the other."""
    for number, q in enumerate(random_rotations(50)):
        put(tf, "parent", f"child{number}", 0)
        put(tf, "parent", f"child{number}", 1, ORIGIN, q)
        middle = look(tf, "parent", f"child{number}", 0.5).transform.rotation
        to_first = 2 * math.acos(min(1.0, abs(middle[3])))
        to_second = 2 * math.acos(min(1.0, abs(float(middle @ q))))
        assert to_first == pytest.approx(to_second, abs=1e-5)
        # ... and lies on the shorter arc between the two.
        assert to_first + to_second == pytest.approx(2 * math.acos(abs(q[3])), abs=1e-5)


def test_B09_angular_interpolation(tf: Tree) -> None:
    """Rotations about one axis turn evenly along the shorter arc, whatever the signs."""
    axes = [np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], np.ones(3) / math.sqrt(3)]
    for number, axis in enumerate(axes):

        def about(angle: float, axis: NDArray[np.float64] = axis) -> NDArray[np.float64]:
            return np.append(math.sin(angle / 2) * axis, math.cos(angle / 2))

        for sign in (1, -1):
            child = f"child{number}{sign}"
            put_ns(tf, "parent", child, 200, ORIGIN, about(-0.08))
            put_ns(tf, "parent", child, 300, ORIGIN, sign * about(0.06))
            found = tf.sample("parent", child, 200 + np.arange(101))
            assert not found.status.any()
            for k, q in enumerate(found.rotations):
                assert rotation_error(q, about(-0.08 + 0.14 * k / 100)) <= 1e-6


def test_B10_duplicate_entries(tf: Tree) -> None:
    """The same sample twice is one sample, and nothing divides by the time between."""
    for _ in range(2):
        put_ns(tf, "parent", "child", 1, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
    assert_pose(tf.lookup_transform("parent", "child", 1), (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
    assert tf.frame("child").samples == 1


def test_B11_out_of_order(tf: Tree) -> None:
    """Late samples are inserted in stamp order."""
    for seconds in (10, 12, 11, 9):
        assert put(tf, "parent", "child", seconds, (seconds, 0, 0))
    for at in (9, 9.5, 10.5, 11.25, 12):
        assert x_of(look(tf, "parent", "child", at)) == pytest.approx(at, abs=1e-6)


@pytest.mark.own_server
def test_B12_same_stamp_other_value(tf: Tree) -> None:
    """[Q] Decision B12: the last value wins at every stamp, and is counted; in tf2 the first one
    wins at the oldest stamp."""
    for seconds in (10, 14, 18):
        put(tf, "parent", "child", seconds, (seconds, 0, 0))
        put(tf, "parent", "child", seconds, (seconds + 0.5, 0, 0))
    for at, x in ((10, 10.5), (14, 14.5), (18, 18.5), (None, 18.5), (12, 12.5)):
        assert x_of(look(tf, "parent", "child", at)) == pytest.approx(x, abs=1e-6)
    assert (tf.frame("child").samples, tf.frame("child").rewritten) == (3, 3)


def test_B13_prune_timing(tf: Tree) -> None:
    """[Q] Decision B13: pruned after the insert, so nothing is interpolated over more than the
    cache time; tf2 answers x = 50 at 50 s."""
    put(tf, "parent", "child", 0, (0, 0, 0))
    put(tf, "parent", "child", 100, (100, 0, 0))
    assert tf.frame("child").samples == 1
    with pytest.raises(NoDataForExtrapolationException):
        look(tf, "parent", "child", 50)
    put(tf, "parent", "child", 101, (101, 0, 0))
    with pytest.raises(BackwardExtrapolationException):
        look(tf, "parent", "child", 50)
