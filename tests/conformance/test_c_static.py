"""C: static transforms, and what `clear` leaves."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_tf import ConnectivityException, NoDataForExtrapolationException

from .conftest import StartLive
from .shorthand import REMOTE, Tree, assert_pose, can, look, ns, put, stamped, x_of

#: No time, and times before, at and after the stamps below.
TIMES = (None, 0, 1, 10, 1000)


def test_C01_static_at_any_time(tf: Tree) -> None:
    """A static link answers at every time, with that time as the stamp; without a time it is 0."""
    put(tf, "a", "b", 1, (1, 2, 3), static=True)
    for seconds in (None, 0, 1, 100, 1000):
        assert can(tf, "a", "b", seconds)
        assert_pose(look(tf, "a", "b", seconds), (1, 2, 3))
    assert look(tf, "a", "b", 2).stamp_ns == ns(2)
    assert look(tf, "a", "b").stamp_ns == 0


def test_C02_static_chain(tf: Tree) -> None:
    """Two static links one after the other answer at every time."""
    put(tf, "a", "b", 1, (1, 0, 0), static=True)
    put(tf, "b", "c", 1, (0, 1, 0), static=True)
    for seconds in (None, 0, 10, 1000):
        assert can(tf, "a", "c", seconds)
        assert_pose(look(tf, "a", "c", seconds), (1, 1, 0))


def test_C03_static_and_dynamic_chain(tf: Tree) -> None:
    """A chain of static and dynamic links answers only at times of the dynamic ones. [Q] Decision
    E12: tf2's time 0 is None here, and stamp 0 is an ordinary time."""
    put(tf, "a", "b", 1, (1, 0, 0), static=True)
    put(tf, "b", "c", 1, (0, 1, 0), static=True)
    put(tf, "c", "d", 10)
    assert can(tf, "c", "d", 10)
    assert [can(tf, "a", "d", seconds) for seconds in TIMES] == [True, False, False, True, False]
    assert look(tf, "a", "d").stamp_ns == ns(10)
    assert_pose(look(tf, "a", "d"), (1, 1, 0))


@pytest.mark.own_server
def test_C04_multiple_parents(tf: Tree) -> None:
    """The last parent set is the parent. [Q] Decision C04: as in tf2, and counted, with the
    authority that did it."""
    for parent, child in ("ab", "bc", "cd"):
        put(tf, parent, child, 1, static=True, authority="first")
    assert can(tf, "a", "d")
    put(tf, "new_parent", "d", 1, static=True, authority="second")
    assert can(tf, "new_parent", "d")
    assert not can(tf, "a", "d")
    info = tf.frame("d")
    assert (info.parent, info.authority) == ("new_parent", "second")
    assert (info.reparented, info.authority_changes) == (1, 1)
    assert info.last_change is not None
    assert (info.last_change.parent_before, info.last_change.authority) == ("c", "second")


def test_C05_static_after_clear(tf: Tree) -> None:
    """After a clear a link that was dynamic can become static."""
    put(tf, "foo", "bar", 1)
    tf.clear()
    put(tf, "foo", "bar", 1, (1, 2, 3), static=True)
    assert_pose(look(tf, "foo", "bar", 2), (1, 2, 3))


@pytest.mark.own_server
def test_C06_switch_between_dynamic_and_static(tf: Tree) -> None:
    """A link that becomes static or dynamic loses its history. [Q] Decision C06: as in tf2, and
    counted, with authority and time."""
    put(tf, "p", "c", 10, (1, 0, 0), authority="joints")
    put(tf, "p", "c", 11, (2, 0, 0), authority="joints")
    put(tf, "p", "c", 0, (9, 0, 0), static=True, authority="urdf")
    for seconds in (None, 0, 10, 10.5, 11, 1000):
        assert x_of(look(tf, "p", "c", seconds)) == 9.0
    assert (tf.frame("c").static, tf.frame("c").samples, tf.frame("c").switched) == (True, 1, 1)
    put(tf, "p", "c", 12, (3, 0, 0), authority="joints")
    with pytest.raises(NoDataForExtrapolationException):
        look(tf, "p", "c", 10)
    assert x_of(look(tf, "p", "c", 12)) == 3.0
    info = tf.frame("c")
    assert (info.static, info.samples, info.switched) == (False, 1, 2)
    assert info.last_change is not None
    assert (info.last_change.kind, info.last_change.static_before) == ("switched", True)
    assert (info.last_change.authority, info.last_change.stamp_ns) == ("joints", ns(12))


def test_C07_clear(tf: Tree) -> None:
    """A clear drops the dynamic data; static links and all names stay."""
    put(tf, "a", "b", 1, static=True)
    put(tf, "b", "c", 1)
    tf.clear()
    assert can(tf, "a", "b", 5)
    assert not can(tf, "b", "c")
    with pytest.raises(ConnectivityException):
        look(tf, "b", "c")
    assert sorted(tf.frames()) == ["a", "b", "c"]


def test_C08_static_repeatability(tf: Tree) -> None:
    """A static link holds its last value for every time, however often it was set. After a clear
    it has no answer."""
    for seconds in range(100):
        put(tf, "p", "c", seconds, (seconds, 0, 0), static=True)
        answer = look(tf, "p", "c", seconds)
        assert (answer.stamp_ns, x_of(answer)) == (ns(seconds), seconds)
    for _ in range(2):
        put(tf, "p", "c", 3, (1, 2, 3), (0.5, 0.5, 0.5, 0.5), static=True)
    assert tf.frame("c").samples == 1
    pose = look(tf, "p", "c", 3).transform
    assert np.isfinite(pose.pose()).all()
    assert_pose(pose, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
    tf.clear(keep_static=False)
    with pytest.raises(ConnectivityException):
        look(tf, "p", "c", 3)


@pytest.mark.parametrize("mode", REMOTE, indirect=True)  # a broadcaster needs a network
def test_C09_static_broadcaster(mode: str, start_live: StartLive) -> None:
    """A broadcaster keeps the newest static link of every child. Clients that join late see all
    of them, also after a restart of the server."""
    live = start_live(mode)
    with live.connect() as robot, robot.broadcaster("urdf") as broadcaster:
        broadcaster.send_static(stamped("a", "b", 1, (1, 0, 0)))
        broadcaster.send_static(stamped("a", "b", 2, (2, 0, 0)))
        broadcaster.send_static(stamped("b", "c", 3, (0, 1, 0)))
        for _ in range(2):
            with live.connect() as late:
                # One publisher's messages arrive in order. Once c is there, b has its last value.
                assert late.can_transform("b", "c", timeout_s=20)
                assert_pose(look(late, "a", "c", 1000), (2, 1, 0))
                assert (late.frame("b").static, late.frame("b").authority) == (True, "urdf")
            live.stop()
            live.start()
