"""Estimates in mirrors: of their own copy, and by the server's clock."""

from __future__ import annotations

import time

import pytest

from tests.support.moving_arm import MS, fill
from tests.support.waiting import wait_until
from zenoh_tf import Estimate, StampedTransform, Transform, TransformTree
from zenoh_tf._core import ChangeLog, ChangeReplay
from zenoh_tf._net.server_clock import ServerClock, now_ns
from zenoh_tf_client import OutsideInterest, TransformClient

END_NS = 10**18
AHEAD_NS = END_NS + 30 * MS


def test_an_interest_has_the_estimates_of_its_pairs(client: TransformClient) -> None:
    fill(client, END_NS)
    with client.mirror([("base", "tool")]) as m:
        found = m.estimate_transform("base", "tool", AHEAD_NS)
        assert found.by_ns == 30 * MS and found.limiting_link == ("base", "arm")
        with pytest.raises(OutsideInterest):
            m.estimate_transform("map", "flag", AHEAD_NS)


def test_now_is_the_servers_clock(client: TransformClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mirror's own machine is an hour behind."""
    end_ns = time.time_ns()
    fill(client, end_ns)
    real = time.time_ns
    with client.mirror() as m:
        wait_until(lambda: m._feed.clock._real[0] != "", "the clocks are compared")
        monkeypatch.setattr(time, "time_ns", lambda: real() - 3_600 * 10**9)
        found = m.estimate_transform("map", "tool", max_by_s=100.0)
        many = m.estimate_transforms("map", ["tool"], None, max_by_s=100.0)
    assert end_ns < found.stamp_ns <= many.stamps_ns[0] <= real() + 10**9
    assert found.by_ns == found.stamp_ns - end_ns


def test_the_clock_of_a_server() -> None:
    clock = ServerClock()
    assert abs(clock.real_ns() - time.time_ns()) < 10**9
    begin_ns = now_ns()
    clock.compared("old", begin_ns, 500)  # a server that does not send its real-time clock
    assert abs(clock.real_ns() - time.time_ns()) < 10**9
    clock.compared("new", begin_ns, 1_000, 77 * 10**9)
    assert 77 * 10**9 <= clock.real_ns() < 87 * 10**9
    clock.compared("new", now_ns(), 2_000)  # a snapshot's reply has none
    assert clock.real_ns() >= 77 * 10**9


def test_backtests_of_a_mirror_know_late_samples() -> None:
    """They were kept, but then the history changed otherwise than by newer samples."""
    end_ns, step_ns = 10**18, 10**8
    tree = TransformTree(max_log_bytes=1 << 24)
    log = ChangeLog(tree)
    log.start()
    stamps_ns = range(end_ns - 100 * step_ns, end_ns + 1, step_ns)
    tree.set_transforms_xact(
        [StampedTransform("map", "base", stamp_ns, Transform()) for stamp_ns in stamps_ns]
    )
    mirror = TransformTree(max_log_bytes=1 << 16)
    replay = ChangeReplay(mirror)

    def follow() -> Estimate:
        _, last, lost, changes = log.take(1 << 24)
        assert not lost and changes is not None
        replay.apply(last, changes)
        return mirror.estimate_transform("map", "base", end_ns + step_ns)

    assert follow().error_m < 1e-6
    wild = [
        StampedTransform("map", "base", end_ns - step_ns // 2 - i * step_ns, Transform((5, 0, 0)))
        for i in range(50)
    ]
    tree.set_transforms_xact(wild)
    found = follow()
    assert found == tree.estimate_transform("map", "base", end_ns + step_ns) and found.error_m > 0.5
