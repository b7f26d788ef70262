"""Removal, reset, change of authority and time jumps, embedded and behind a server."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from tests.conftest import LendServer
from zenoh_tf import (
    AuthorityInfo,
    BackwardExtrapolationException,
    FrameChange,
    InvalidArgumentException,
    LookupException,
    StampedTransform,
    Transform,
    TransformTree,
)
from zenoh_tf_client import TransformClient

SECOND = 1_000_000_000

Tf = TransformTree | TransformClient
MakeTf = Callable[..., Tf]


@pytest.fixture(params=["embedded", "remote"])
def make_tf(request: pytest.FixtureRequest, lend_server: LendServer) -> Iterator[MakeTf]:
    clients: list[TransformClient] = []

    def make(time_jump: str = "reject") -> Tf:
        if request.param == "embedded":
            return TransformTree(time_jump=time_jump)  # type: ignore[arg-type]
        client = lend_server("--time-jump", time_jump).connect()
        clients.append(client)
        return client

    yield make
    for client in clients:
        client.close()


@pytest.fixture
def tf(make_tf: MakeTf) -> Tf:
    return make_tf()


def put(tf: Tf, parent: str, child: str, seconds: float, x: float = 1.0, **how: object) -> bool:
    transform = Transform(translation=(x, 0.0, 0.0))
    stamped = StampedTransform(parent, child, int(seconds * SECOND), transform)
    return tf.set_transform(stamped, **how)  # type: ignore[arg-type]


def test_a_removed_frame_is_gone_with_its_link_history_and_name(tf: Tf) -> None:
    put(tf, "map", "base", 1)
    put(tf, "base", "cup", 1)
    put(tf, "base", "cup", 2)
    tf.remove_frame("cup")
    assert tf.frames() == ["base", "map"]
    assert tf.stats()["frames"] == 2
    assert not tf.can_transform("map", "cup")
    for call in (tf.frame, tf.parent, tf.remove_frame):
        with pytest.raises(LookupException) as caught:
            call("cup")
        assert caught.value.frame == "cup"
    with pytest.raises(LookupException):
        tf.lookup_transform("cup", "cup")
    assert tf.lookup_transform("map", "base").stamp_ns == SECOND


@pytest.mark.own_server
def test_a_removed_frame_comes_back_empty_with_the_next_set(tf: Tf) -> None:
    put(tf, "map", "cup", 1, authority="left")
    put(tf, "map", "cup", 2, authority="left")
    tf.remove_frame("cup")
    put(tf, "map", "cup", 1.5, authority="right")
    info = tf.frame("cup")
    assert (info.samples, info.authority, info.authority_changes) == (1, "right", 0)
    assert tf.frames() == ["cup", "map"]


def test_a_parent_is_not_removed_from_under_its_children(tf: Tf) -> None:
    put(tf, "map", "base", 1)
    put(tf, "base", "arm", 1)
    with pytest.raises(InvalidArgumentException) as caught:
        tf.remove_frame("base")
    assert (caught.value.field, caught.value.frame, caught.value.parent_frame) == (
        "name",
        "arm",
        "base",
    )
    assert tf.can_transform("map", "arm")


def test_a_subtree_is_removed_at_once(tf: Tf) -> None:
    for parent, child in [("map", "r1"), ("r1", "arm"), ("arm", "hand"), ("map", "r2")]:
        put(tf, parent, child, 1)
    commits = tf.stats()["commits"]
    tf.remove_frame("r1", subtree=True)
    assert tf.stats()["commits"] == commits + 1
    assert sorted(tf.frames()) == ["map", "r2"]
    tf.remove_frame("map", subtree=True)
    assert tf.frames() == []


def test_invalid_names_cannot_be_removed(tf: Tf) -> None:
    for name in ("", "/map"):
        with pytest.raises(InvalidArgumentException) as caught:
            tf.remove_frame(name)
        assert caught.value.field == "name"


@pytest.mark.own_server
def test_reset_drops_samples_static_links_and_names(tf: Tf) -> None:
    put(tf, "map", "base", 1, authority="wheels")
    put(tf, "base", "camera", 0, authority="mounts", static=True)
    commits = tf.stats()["commits"]
    tf.reset()
    assert tf.frames() == []
    stats = tf.stats()
    assert (stats["frames"], stats["samples"], stats["static_links"]) == (0, 0, 0)
    assert stats["commits"] == commits + 1
    with pytest.raises(LookupException):
        tf.lookup_transform("base", "camera")
    with pytest.raises(LookupException):
        tf.frame("map")
    # What authorities have done is not forgotten, and the names may come back.
    assert [authority.name for authority in tf.authorities()] == ["wheels", "mounts"]
    put(tf, "camera", "map", 0.5, authority="other")
    assert sorted(tf.frames()) == ["camera", "map"]
    assert tf.frame("map").samples == 1
    tf.reset()
    tf.reset()
    assert tf.frames() == []


@pytest.mark.parametrize("how", ["reset", "remove_frame"])
def test_a_frame_that_comes_back_counts_from_zero(tf: Tf, how: str) -> None:
    def events() -> list[object]:
        info = tf.frame("base")
        counts = (info.rewritten, info.dropped, info.reparented, info.switched)
        return [*counts, info.authority_changes, info.last_change]

    put(tf, "map", "base", 100, authority="left")
    put(tf, "map", "base", 100, authority="left")
    put(tf, "map", "base", 1, authority="left")
    put(tf, "dock", "base", 101, authority="right")
    put(tf, "dock", "base", 0, authority="right", static=True)
    put(tf, "dock", "base", 102, authority="left")
    assert events()[:-1] == [1, 1, 1, 2, 2]
    counters = ("rewritten", "dropped", "evicted", "commits")
    before = [tf.stats()[name] for name in counters]
    if how == "reset":
        tf.reset()
    else:
        tf.remove_frame("base")
    before[-1] += 1
    assert [tf.stats()[name] for name in counters] == before  # what metrics count never goes back
    put(tf, "map", "base", 1, authority="right")
    assert events() == [0, 0, 0, 0, 0, None]
    put(tf, "map", "base", 1, authority="right")
    assert tf.stats()["rewritten"] == before[0] + 1


def test_a_second_late_transform_begins_its_frame_again(make_tf: MakeTf) -> None:
    tf = make_tf(time_jump="clear")
    put(tf, "map", "base", 100)
    put(tf, "base", "arm", 100)
    put(tf, "base", "camera", 0, static=True)
    assert put(tf, "map", "base", 95)  # late, but not too late
    assert not put(tf, "map", "base", 1)
    assert tf.stats()["time_jumps"] == 0
    assert put(tf, "map", "base", 1.1, x=7.0)
    assert (tf.stats()["time_jumps"], tf.frame("base").time_jumps) == (1, 1)
    jump = tf.frame("base").last_time_jump
    assert jump is not None
    assert jump.newest_stamp_ns == 100 * SECOND
    assert jump.at_ns <= time.time_ns()
    assert tf.lookup_transform("map", "camera").stamp_ns == 1_100_000_000
    # No other frame is touched.
    assert (tf.frame("arm").newest_stamp_ns, tf.frame("arm").time_jumps) == (100 * SECOND, 0)
    back = StampedTransform("base", "arm", SECOND, Transform())
    with pytest.raises(InvalidArgumentException, match="begins the frame's history again"):
        tf.set_transforms_xact([back])
    assert not put(tf, "base", "arm", 1)  # the same stamp is no second witness
    tf.set_transforms_xact([StampedTransform("base", "arm", 1_100_000_000, Transform())])
    assert tf.stats()["time_jumps"] == 2
    assert tf.can_transform("map", "arm")


@pytest.mark.parametrize("time_jump", ["reject", "clear"])
@pytest.mark.own_server
def test_a_frame_recovers_from_a_stamp_far_ahead(make_tf: MakeTf, time_jump: str) -> None:
    tf = make_tf(time_jump)
    now = time.time()
    put(tf, "map", "base", now)
    put(tf, "map", "arm", now)
    put(tf, "map", "base", now + 1800)
    assert not put(tf, "map", "base", now + 0.1)
    assert put(tf, "map", "base", now + 0.2)
    assert put(tf, "map", "base", now + 0.3)
    assert tf.frame("base").time_jumps == 1
    assert tf.lookup_transform("map", "base").stamp_ns == int((now + 0.3) * SECOND)
    assert tf.frame("arm").samples == 1


def test_a_rejected_write_that_jumps_back_clears_nothing(make_tf: MakeTf) -> None:
    tf = make_tf(time_jump="clear")
    put(tf, "map", "base", 100)
    for stamp in (1, 2):
        back = [
            StampedTransform(*pair, stamp, Transform())
            for pair in [("map", "base"), ("base", "map")]
        ]
        with pytest.raises(InvalidArgumentException):
            tf.set_transforms_xact(back)
    assert tf.frame("base").newest_stamp_ns == 100 * SECOND


def test_backward_extrapolation_names_the_link_at_that_time(tf: Tf) -> None:
    put(tf, "dock", "base", 1)
    put(tf, "map", "base", 2)
    put(tf, "map", "base", 3)
    with pytest.raises(BackwardExtrapolationException) as caught:
        tf.lookup_transform("map", "base", SECOND // 2)
    error = caught.value
    assert (error.frame, error.parent_frame) == ("base", "dock")
    assert (error.oldest_stamp_ns, error.newest_stamp_ns) == (SECOND, 3 * SECOND)
    assert error.stamp_ns == SECOND // 2
    for fact in ("'dock'", "'base'", "1000000000", "3000000000", "500000000"):
        assert fact in str(error)


@pytest.mark.own_server
def test_a_static_value_that_is_replaced(tf: Tf) -> None:
    def mount(x_m: float, yaw: tuple[float, ...], authority: str) -> None:
        at = StampedTransform("base", "camera", 0, Transform((x_m, 0, 0), yaw))
        tf.set_transform(at, authority=authority, static=True)

    for authority in ("urdf", "replay", "urdf"):
        mount(0.3, (0, 0, 0, 1), authority)
    assert tf.frame("camera").last_replacement is None
    mount(0.3, (0, 0, 0, -1), "urdf")  # the same rotation
    assert tf.frame("camera").last_replacement is None
    begin_ns = time.time_ns()
    mount(0.3, (0, 0, 1, 0), "replay")
    mount(0.55, (0, 0, 1, 0), "replay")
    last = tf.frame("camera").last_replacement
    assert last is not None
    assert (last.count, last.shift_m, last.turn_rad) == (2, 0.25, 0.0)
    assert last.authority_before == "replay"
    assert begin_ns <= last.at_ns <= time.time_ns()
    put(tf, "base", "camera", 1)
    assert tf.frame("camera").last_replacement == last  # another kind of link is no value
    tf.reset()
    mount(0.3, (0, 0, 0, 1), "urdf")
    assert tf.frame("camera").last_replacement is None


@pytest.mark.own_server
def test_the_last_change_of_a_link(tf: Tf) -> None:
    put(tf, "map", "base", 1, authority="odometry")
    assert tf.frame("base").last_change is None
    put(tf, "map", "base", 2, authority="lidar")
    assert tf.frame("base").last_change == FrameChange(
        "authority", 2 * SECOND, "lidar", "map", False, "odometry"
    )
    put(tf, "dock", "base", 3, authority="lidar")
    expected = FrameChange("reparented", 3 * SECOND, "lidar", "map", False, "lidar")
    assert tf.frame("base").last_change == expected
    put(tf, "dock", "base", 4, 7.0, authority="charger", static=True)
    info = tf.frame("base")
    assert info.last_change == FrameChange(
        "switched", 4 * SECOND, "charger", "dock", False, "lidar"
    )
    assert list(info.last_change.pose_before) == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    assert (info.authority_changes, info.reparented, info.switched) == (2, 1, 1)


@pytest.mark.own_server
def test_counters_of_each_authority(tf: Tf) -> None:
    put(tf, "map", "base", 1)  # without an authority
    put(tf, "map", "base", 100, authority="a")
    put(tf, "map", "base", 100, authority="a")
    put(tf, "map", "base", 1, authority="a")
    put(tf, "map", "arm", 1, authority="b")
    put(tf, "map", "base", 101, authority="b")
    assert tf.authorities() == [
        AuthorityInfo("a", frames=0, commits=3, stored=2, dropped=1, rewritten=1, conflicts=1),
        AuthorityInfo("b", frames=2, commits=2, stored=2, dropped=0, rewritten=0, conflicts=1),
    ]
