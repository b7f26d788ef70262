"""Mirrors of some pairs of frames, and thinned ones, on running servers."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.small_robot import DEADLINE_S, robot, stamped
from tests.support.waiting import wait_until
from zenoh_tf import TransformTree, wire
from zenoh_tf.errors import (
    ConnectivityException,
    InvalidArgumentException,
    LimitExceeded,
    LookupException,
    ServerBusy,
    TransformException,
)
from zenoh_tf_client import OutsideInterest, TransformClient
from zenoh_tf_server.limits import Limits
from zenoh_tf_server.streams.interests import Interests
from zenoh_tf_server.streams.stream import Stream


def test_the_frames_on_the_ways_and_no_others(client: TransformClient) -> None:
    for stamp in range(1, 11):
        robot(client, stamp)
    client.set_transform(stamped("table", 1, 7), static=True, authority="calibration")
    with client.mirror([("gripper", "camera")]) as m:
        assert sorted(m.frames()) == ["arm", "base", "camera", "gripper"]
        for at in (None, 3, 10):
            mine = m.lookup_transform("camera", "gripper", at)
            assert mine == client.lookup_transform("camera", "gripper", at)
        assert m.parent("base") == "odom"
        assert m.chain("camera", "gripper") == ["camera", "base", "arm", "gripper"]
        assert m.frame("base").version == client.frame("base").version
        latest = client.lookup_latest_transform_xact("arm", "camera")
        assert m.lookup_latest_transform_xact("arm", "camera") == latest
        assert m.lookup_latest_transform("arm", "camera") == latest
        assert m.synced
        robot(client, 11)
        m.wait_for()
        assert m.lookup_transform("camera", "gripper").stamp_ns == 11
        poses = m.sample("camera", "gripper", np.arange(1, 12)).translations
        expected = client.sample("camera", "gripper", np.arange(1, 12)).translations
        assert np.array_equal(poses, expected)


def test_questions_about_other_frames(client: TransformClient) -> None:
    robot(client, 1)
    client.set_transform(stamped("gripper2", 1))
    with client.mirror([("arm", "gripper"), ("arm", "later"), ("camera", "camera")]) as m:
        for ask in (
            lambda: m.lookup_transform("map", "gripper"),
            lambda: m.lookup_transform("gripper", "nowhere"),
            lambda: m.lookup_latest_transform("gripper", "odom"),
            lambda: m.lookup_latest_transforms_xact([("arm", "gripper"), ("odom", "arm")]),
            lambda: m.frame("odom"),
            lambda: m.parent("odom"),
            lambda: m.explain("gripper", "odom"),
            lambda: m.run_transaction(lambda tx: tx.lookup_transform("map", "gripper")),
        ):
            with pytest.raises(OutsideInterest) as caught:
                ask()
            assert caught.value.frame in ("map", "odom", "nowhere")
        with pytest.raises(LookupException) as unknown:  # it is wanted, but does not exist
            m.lookup_transform("arm", "later")
        assert not isinstance(unknown.value, OutsideInterest)
        # Both have "base" above them, which the mirror does not need for its pairs.
        assert m.lookup_transform("gripper", "camera") == client.lookup_transform(
            "gripper", "camera"
        )
        assert not m.can_transform("map", "gripper")
        assert m.lookup_transforms("arm", ["gripper", "odom"], None).status[1] == 2
        # By query, all frames are known.
        assert m.lookup_latest_transform("map", "gripper", max_age_s=-1).stamp_ns == 1
        client.set_transform(stamped("later", 1, 5, "elsewhere"))
        m.wait_for()
        with pytest.raises(ConnectivityException):
            m.lookup_transform("arm", "later")
        client.set_transform(stamped("elsewhere", 1, 5, "arm"))
        m.wait_for()
        assert m.lookup_transform("arm", "later").transform.translation[0] == 10


def test_new_ancestors_come_with_the_change(server: ServerProcess, client: TransformClient) -> None:
    """An object goes from a table into a gripper and back: what is read is of one commit."""
    robot(client, 1)
    client.set_transform(stamped("table", 1, 100), static=True)
    client.set_transform(stamped("object", 1, 1, "table"))
    with server.connect() as other, other.mirror([("map", "object")]) as m:
        snapshots = m._feed.snapshots
        for round_ in range(1, 30):
            holder = ("gripper", "table")[round_ % 2]
            now = round_ + 1
            links = [stamped("odom", now, now), stamped("object", now, 1, holder)]
            client.set_transforms_xact(links)
            expected = client.lookup_latest_transform_xact("map", "object")
            deadline = time.monotonic() + DEADLINE_S
            while (found := m.lookup_latest_transform_xact("map", "object")) != expected:
                # Nothing else than the state before is ever read.
                assert found.newest_stamp_ns == now - 1
                assert time.monotonic() < deadline
            m.wait_for(client.last_receipt)
            for name in m.frames():
                assert m.frame(name).version == client.frame(name).version
            assert {"map", "object", holder} <= {*m.frames()}
            assert "camera" not in m.frames()
        assert m._feed.snapshots == snapshots


def test_removed_cleared_and_reset(client: TransformClient) -> None:
    robot(client, 1)
    pair = ("map", "gripper")
    with client.mirror([pair]) as m:
        client.remove_frame("gripper")
        m.wait_for()
        with pytest.raises(LookupException):
            m.lookup_transform(*pair)
        assert m.frames() == ["map"]
        robot(client, 2)
        m.wait_for()
        assert m.lookup_transform(*pair) == client.lookup_transform(*pair)
        client.clear()
        m.wait_for()
        with pytest.raises(ConnectivityException):
            m.lookup_transform(*pair)
        assert sorted(m.frames()) == ["gripper", "map"]
        robot(client, 1)  # an earlier time
        m.wait_for()
        assert m.lookup_transform(*pair).stamp_ns == 1


def test_a_thinned_mirror(server: ServerProcess, client: TransformClient) -> None:
    """Few messages, each of which is a state that the server has had, with its versions."""
    robot(client, 1)
    with server.connect() as other, other.mirror(max_rate_hz=5) as m, other.mirror() as full:
        assert sorted(m.frames()) == sorted(client.frames())
        begin = client.stats()
        deadline_s = time.monotonic() + DEADLINE_S
        stamp = 1
        seen: set[int] = set()
        while len(seen) < 8 or stamp < 300:
            assert time.monotonic() < deadline_s
            stamp += 1
            robot(client, stamp)
            pairs = [("map", "odom"), ("odom", "base"), ("arm", "gripper")]
            stamps = {one.stamp_ns for one in m.lookup_latest_transforms_xact(pairs)}
            assert len(stamps) == 1
            seen |= stamps
        now = client.stats()
        # With the heartbeats in between: far fewer than there are commits.
        assert now["interest_messages"] - begin["interest_messages"] < stamp / 2
        m.wait_for(client.last_receipt)
        full.wait_for(client.last_receipt)
        assert m.lookup_transform("map", "gripper") == full.lookup_transform("map", "gripper")
        assert m.frame("base").version == full.frame("base").version
        assert m.frame("base").samples < full.frame("base").samples
        assert m.age_s < DEADLINE_S
        client.remove_frame("camera")
        m.wait_for(client.last_receipt)
        assert "camera" not in m.frames()


def test_equal_interests_share_a_stream_that_ends(
    server: ServerProcess, client: TransformClient
) -> None:
    robot(client, 1)
    pair = ("map", "gripper")
    wait_until(lambda: client.stats()["interests"] == 0, "interests of another test are left")
    with server.connect() as one, server.connect() as two:
        first = one.mirror([pair, ("camera", "arm")])
        second = two.mirror([("arm", "camera"), pair[::-1]])
        assert client.stats()["interests"] == 1
        assert client.stats()["interest_frames"] == 6
        third = two.mirror([pair])
        assert client.stats()["interests"] == 2
        first.close()
        robot(client, 2)
        second.wait_for(client.last_receipt)
        assert second.lookup_transform(*pair).stamp_ns == 2
        third.close()  # nobody listens to this one
    wait_until(lambda: client.stats()["interests"] == 0, "interests are left")


def test_bad_arguments(client: TransformClient) -> None:
    for pairs in ([], "ab", [("a",)], ["ab"], [("a", "b", "c")], [("a", "")], [("a", 1)]):
        with pytest.raises(InvalidArgumentException) as caught:
            client.mirror(pairs)  # type: ignore[arg-type]
        assert caught.value.field == "pairs"
    for rate in (0, -1, float("nan"), float("inf"), 1e9):
        with pytest.raises(InvalidArgumentException) as caught:
            client.mirror(max_rate_hz=rate)
        assert caught.value.field == "max_rate_hz"
    with pytest.raises(InvalidArgumentException):
        client.mirror([("a", "\ud800")])
    for wrong in (
        lambda: client.mirror([("a", "b")], max_delay_s=-1),
        lambda: client.mirror([("a", "b")], max_delay_s=float("nan")),
        lambda: client.mirror(max_delay_s=1),
        lambda: client.mirror([("a", "b")], max_delay_s=1, max_rate_hz=1),
    ):
        with pytest.raises(InvalidArgumentException) as caught:
            wrong()
        assert caught.value.field == "max_delay_s"
    assert client.stats()["interests"] == 0


@pytest.mark.slow
def test_limits(start_server: StartServer) -> None:
    server = start_server("--limit", "interests=4", "--limit", "interest_frames=5")
    with server.connect(1) as tf, server.connect(1) as other:
        robot(tf, 1)
        with pytest.raises(LimitExceeded) as caught:
            tf.mirror([(f"a{i}", "b") for i in range(1001)])
        assert caught.value.field == "interest_pairs"
        with pytest.raises(LimitExceeded) as caught:
            tf.mirror([("a" * 300, "b")])
        assert caught.value.field == "name_bytes"
        with pytest.raises(LimitExceeded) as caught:
            tf.mirror(max_rate_hz=1)
        assert caught.value.field == "interest_frames"
        wait_until(lambda: tf.stats()["interests"] == 0, "refused interests are left")
        with tf.mirror([("base", "camera")]) as m, tf.mirror([("x", "y")]):
            with pytest.raises(ServerBusy):  # half of them are for others
                tf.mirror([("v", "w")], timeout_s=2)
            with other.mirror([("arm", "arm")]) as small:
                assert small.frames() == ["arm"]
                # The paths get longer than there is room for: the last state stays, and ages.
                tf.set_transforms_xact([stamped(f"x{i}", 1, 0, f"x{i - 1}") for i in range(1, 9)])
                tf.set_transform(stamped("camera", 2, 0, "x8"))
                tf.set_transform(stamped("x0", 2, 0, "base"))
                wait_until(lambda: m.age_s > 1, "it does not age")
                assert m.lookup_transform("base", "camera").stamp_ns == 1
                with pytest.raises(TransformException):
                    tf.mirror([("base", "camera")], timeout_s=0.5)


def test_a_greedy_client_does_not_end_the_small_interest_of_another() -> None:
    tree = TransformTree(max_log_bytes=1 << 20)
    tree.set_transforms_xact([stamped(f"x{i}", 1) for i in range(87)])
    tree.set_transform(stamped("base", 1, 0, "odom"))
    limits = Limits(interest_frames=100)
    interests = Interests(tree, Stream(tree, "instance", limits), "instance", limits)
    settings = wire.TreeSettings(10**10, 1000, 1000, 255, 64)
    small, everything = wire.Interest.of([("base", "odom")]), wire.Interest((), 1)
    interests.snapshot(small, "small", settings)
    interests.snapshot(everything, "greedy", settings)
    assert interests.counters()["interest_frames"] == 2 + 90
    # The small one needs more than is free, but less than its client's share.
    path = ["odom", *(f"y{i}" for i in range(10)), "base"]
    tree.set_transforms_xact([stamped(b, 2, 0, a) for a, b in pairwise(path)])
    interests._publish_one(interests._interests[small.id])
    assert interests.counters()["interest_frames"] == 12 + 90
    interests._publish_one(interests._interests[everything.id])
    assert [*interests._interests] == [small.id]
    with pytest.raises(ServerBusy, match=r"112 frames .* its share") as caught:
        interests.snapshot(everything, "greedy", settings)
    assert caught.value.field == "interest_frames"
    assert (caught.value.limit, caught.value.value) == (100, 112)
