"""Declared limits of motion, and errors of clocks, in the bounds of estimates."""

from __future__ import annotations

import math

import pytest

from tests.support.moving_arm import MS
from tests.tree.test_estimates import END_NS, moving, off
from zenoh_tf import InvalidArgumentException, StampedTransform, Transform


def test_limits_of_motion_are_a_guarantee() -> None:
    """A base at rest may start: only limits know how fast."""
    tree = moving(lambda _: Transform((1, 0, 0)))
    stamp_ns = END_NS + 100 * MS
    assert tree.estimate_transform("map", "base", stamp_ns).error_m < 1e-6
    tree.set_motion_limits("base", max_speed_m_s=2.0, max_rate_rad_s=0.5)
    found = tree.estimate_transform("map", "base", stamp_ns, level=0.9999)
    assert found.error_m == pytest.approx(0.2) and found.error_rad == pytest.approx(0.05)
    assert found.basis == "limits" and found.level == 0.9999
    tree.set_transform(StampedTransform("base", "tip", 0, Transform((3, 0, 0))), static=True)
    tip = tree.estimate_transform("map", "tip", stamp_ns)
    assert tip.error_m == pytest.approx(0.2 + 6 * math.sin(0.025))
    tree.set_motion_limits("base", max_speed_m_s=2.0)
    partly = tree.estimate_transform("map", "base", stamp_ns)
    assert partly.basis == "backtest" and partly.error_m == pytest.approx(0.2)
    tree.set_motion_limits("base")
    assert tree.estimate_transform("map", "base", stamp_ns).error_m < 1e-6
    with pytest.raises(InvalidArgumentException) as caught:
        tree.set_motion_limits("base", max_rate_rad_s=-1.0)
    assert caught.value.field == "max_rate_rad_s"


def test_errors_of_clocks_add_what_the_link_moves_meanwhile() -> None:
    tree = moving(lambda seconds: Transform((seconds, 0, 0)))
    tree.set_transform(StampedTransform("base", "tip", 0, Transform((3, 0, 0))), static=True)
    for stamp_ns in (END_NS, END_NS - 20 * MS, END_NS + 100 * MS):
        assert tree.estimate_transform("map", "tip", stamp_ns).error_m < 1e-6
        tree.set_motion_limits("base", max_clock_error_s=0.02)
        for ends in (("map", "tip"), ("tip", "map")):
            found = tree.estimate_transform(*ends, stamp_ns)
            assert found.error_m == pytest.approx(0.02) and found.error_rad < 1e-6
            assert found.basis == "backtest" and found.limiting_link == ("map", "base")
        tree.set_motion_limits("base")
    turning = moving(lambda seconds: Transform.from_rpy(0, 0, seconds % math.tau))
    turning.set_transform(StampedTransform("base", "tip", 0, Transform((3, 0, 0))), static=True)
    turning.set_motion_limits("base", max_clock_error_s=0.1)
    for ends, arm_m in ((("map", "tip"), 3), (("tip", "map"), 0)):
        found = turning.estimate_transform(*ends, END_NS)
        assert found.error_rad == pytest.approx(0.1)
        assert found.error_m == pytest.approx(arm_m * 2 * math.sin(0.05), abs=1e-6)
    turning.set_motion_limits("base", max_clock_error_s=20)
    assert turning.estimate_transform("map", "tip", END_NS).error_m == math.inf


def test_a_guarantee_with_a_wrong_clock_needs_limits_of_speed() -> None:
    tree = moving(lambda _: Transform((1, 0, 0)))
    limits = {"max_speed_m_s": 2.0, "max_rate_rad_s": 0.5, "max_clock_error_s": 0.05}
    tree.set_motion_limits("base", **limits)
    found = tree.estimate_transform("map", "base", END_NS + 100 * MS)
    assert found.basis == "limits"
    assert (found.error_m, found.error_rad) == pytest.approx((0.3, 0.075))
    exact = tree.estimate_transform("map", "base", END_NS)
    assert exact.basis == "limits" and exact.error_m == pytest.approx(0.1)
    del limits["max_rate_rad_s"]
    tree.set_motion_limits("base", **limits, max_rate_accel_rad_s2=1.0)
    assert tree.estimate_transform("map", "base", END_NS).basis == "backtest"
    for wrong in (-1.0, math.inf, math.nan):
        with pytest.raises(InvalidArgumentException) as caught:
            tree.set_motion_limits("base", max_clock_error_s=wrong)
        assert caught.value.field == "max_clock_error_s"


def test_limits_of_acceleration_hold() -> None:
    """The hardest braking that the limits allow, from 1 m/s, is within the bound."""
    tree = moving(lambda seconds: Transform((seconds, 0, 0)))
    tree.set_motion_limits("base", max_accel_m_s2=4.0, max_rate_rad_s=0.0)
    found = tree.estimate_transform("map", "base", END_NS + 100 * MS)
    braked = Transform((0.1 - 0.5 * 4.0 * 0.1**2, 0, 0))
    assert off(found, braked) <= found.error_m < 0.04 and found.basis == "limits"
