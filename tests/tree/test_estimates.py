"""Estimates of the embedded tree: poses beyond the newest samples, and bounds of their errors."""

from __future__ import annotations

import copy
import math
import pickle
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from tests.support.moving_arm import MS, fill, tool_at
from tests.support.runs import CONTROLS
from zenoh_tf import (
    BackwardExtrapolationException,
    ConnectivityException,
    Estimate,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LookupException,
    NoDataForExtrapolationException,
    StampedTransform,
    TooUncertain,
    Transform,
    TransformTree,
)

END_NS = 10**18
S = 1_000 * MS
Motion = Callable[[float], Transform]


def circle(seconds: float) -> Transform:
    """1 m/s on a circle of 2 m: a constant body twist."""
    angle = 0.5 * seconds
    return Transform.from_rpy(0, 0, angle, (2 * math.sin(angle), -2 * math.cos(angle), 0))


def put(
    tree: TransformTree,
    motion: Motion,
    stamps_ns: Iterable[int],
    child: str = "base",
    parent: str = "map",
) -> None:
    tree.set_transforms_xact(
        [
            StampedTransform(parent, child, stamp, motion((stamp - END_NS) * 1e-9))
            for stamp in stamps_ns
        ]
    )


def moving(motion: Motion, seconds: int = 9, period_ns: int = 50 * MS) -> TransformTree:
    """A tree whose base is published up to END_NS."""
    tree = TransformTree()
    put(tree, motion, range(END_NS - seconds * S, END_NS + 1, period_ns))
    return tree


def off(found: Estimate, truth: Transform) -> float:
    return float(np.linalg.norm(found.transform.translation - truth.translation))


def test_static_links_have_no_error() -> None:
    tree = TransformTree()
    tree.set_transform(StampedTransform("a", "b", 0, Transform((1, 2, 3))), static=True)
    found = tree.estimate_transform("b", "a", max_error_m=0.0, max_error_rad=0.0, level=0.999)
    assert found.basis == "static" and found.level == 1
    assert (found.error_m, found.error_rad, found.by_ns, found.predictor) == (0, 0, 0, {})
    assert found.limiting_link is None
    np.testing.assert_allclose(found.transform.translation, (-1, -2, -3))
    same = tree.estimate_transform("a", "a")
    assert same.basis == "static" and same.transform == Transform()
    assert abs(same.stamp_ns - time.time_ns()) < 60 * S


def test_a_constant_twist_is_continued() -> None:
    tree = moving(circle)
    for by_ms in (1, 20, 80, 300):
        found = tree.estimate_transform("map", "base", END_NS + by_ms * MS)
        assert off(found, circle(by_ms * 1e-3)) < 1e-6
        assert found.error_m < 2e-3  # between samples the chord is 0.2 mm from the circle
        assert found.predictor == {"base": "twist"} and found.by_ns == by_ms * MS
        assert found.basis == "backtest" and found.level == 0.9
    inverse = tree.estimate_transform("base", "map", END_NS + 80 * MS)
    assert off(inverse, circle(0.08).inverse()) < 1e-6


@pytest.mark.parametrize("period_ms", [50, 100])
@pytest.mark.parametrize("by_ms", [5, 20, 45])
def test_the_bound_is_that_of_samples_as_old(period_ms: int, by_ms: int) -> None:
    """A link that speeds up is off by more, the older its sample. Where samples come seldom, most
    of the past instants have a sample that is older than the question's."""

    def faster(seconds: float) -> Transform:
        return Transform((seconds * seconds / 2, 0, 0))

    tree = moving(faster, period_ns=period_ms * MS)
    found = tree.estimate_transform("map", "base", END_NS + by_ms * MS)
    error_m = off(found, faster(by_ms * 1e-3))
    assert error_m <= found.error_m <= 2.5 * error_m


@pytest.mark.parametrize("jump_m", [2.0, 50.0])
def test_no_backtest_carries_a_link_over_a_gap(jump_m: float) -> None:
    def jumped(seconds: float) -> Transform:
        return Transform((0.5 * seconds + (jump_m if seconds > -1 else 0), 0, 0))

    tree = TransformTree()
    put(tree, jumped, range(END_NS - 9 * S, END_NS - 2 * S, 100 * MS))
    put(tree, jumped, range(END_NS - 400 * MS, END_NS + 1, 100 * MS))
    found = tree.estimate_transform("map", "base", END_NS + 80 * MS)
    assert off(found, jumped(0.08)) <= found.error_m < 0.1


def test_between_samples_it_interpolates() -> None:
    tree = moving(circle)
    found = tree.estimate_transform("map", "base", END_NS - 25 * MS)
    looked_up = tree.lookup_transform("map", "base", END_NS - 25 * MS).transform
    assert found.transform.pose() == looked_up.pose()
    assert found.by_ns == 0 and found.predictor == {}
    assert off(found, circle(-0.025)) <= found.error_m < 0.01
    exact = tree.estimate_transform("map", "base", END_NS - 50 * MS)
    assert (exact.error_m, exact.error_rad, exact.level) == (0, 0, 1)


def test_noise_makes_the_bound() -> None:
    """Errors that nobody can predict: the bound holds for about as many as it says."""
    random = np.random.default_rng(1)
    tree = moving(lambda _: Transform(tuple(random.normal(0, 0.01, 3))), 60, 10 * MS)
    found = tree.estimate_transform("map", "base", END_NS + 20 * MS)
    assert 0.005 < found.error_m < 0.1
    assert found.limiting_link == ("map", "base")
    assert found.error_rad < 1e-6


def test_after_rest_the_first_motion_is_known_soon() -> None:
    """At rest nothing says how it will start; half a second later it is seen."""
    tree = moving(lambda seconds: Transform((max(seconds + 0.4, 0), 0, 0)))
    at_rest = tree.estimate_transform("map", "base", END_NS - 1_500 * MS + 1)
    assert at_rest.error_m < 1e-6
    found = tree.estimate_transform("map", "base", END_NS + 100 * MS)
    assert off(found, Transform((0.5, 0, 0))) < 1e-6 and found.predictor == {"base": "twist"}


def test_the_bound_grows_with_the_lag_and_the_radius() -> None:
    tree = TransformTree()
    fill(tree, END_NS)
    bounds = [
        tree.estimate_transform("map", "tool", END_NS + by_ms * MS).error_m
        for by_ms in (5, 20, 50, 100, 200)
    ]
    assert bounds == sorted(bounds) and bounds[-1] > 4 * bounds[0]
    point = tree.estimate_transform("map", "tool", END_NS + 50 * MS)
    body = tree.estimate_transform("map", "tool", END_NS + 50 * MS, radius_m=2.0)
    rim = 4 * math.sin(point.error_rad / 2)
    assert body.error_m == pytest.approx(point.error_m + rim)
    assert off(point, tool_at(END_NS + 50 * MS)) <= point.error_m


def test_too_little_history_says_so() -> None:
    tree = TransformTree()
    put(tree, circle, [END_NS])
    with pytest.raises(NoDataForExtrapolationException):
        tree.estimate_transform("map", "base", END_NS - 1)
    single = tree.estimate_transform("map", "base", END_NS + 10 * MS)
    assert single.transform.pose() == pytest.approx(circle(0).pose())
    assert math.isinf(single.error_m) and (single.level, single.backtests) == (0, 0)
    with pytest.raises(TooUncertain):
        tree.estimate_transform("map", "base", END_NS + 10 * MS, max_error_m=1e6)
    short = moving(circle, 2)
    found = short.estimate_transform("map", "base", END_NS + 10 * MS)
    assert found.backtests < 9 and found.level == found.backtests / (found.backtests + 1)
    with pytest.raises(TooUncertain, match="support the level"):
        short.estimate_transform("map", "base", END_NS + 10 * MS, max_error_m=1.0)
    short.estimate_transform("map", "base", END_NS + 10 * MS, max_error_m=1.0, min_level=0.6)


def test_high_levels_need_a_long_history() -> None:
    stamps_ns = range(END_NS - 70 * S, END_NS + 1, 50 * MS)
    levels = []
    for cache_time_s in (10.0, 80.0):
        tree = TransformTree(cache_time_s)
        put(tree, circle, stamps_ns)
        found = tree.estimate_transform("map", "base", END_NS + 10 * MS, level=0.99)
        levels.append(found.level)
        assert found.level == min(0.99, found.backtests / (found.backtests + 1))
    assert levels[0] < 0.96 and levels[1] == 0.99


def test_refusal_carries_its_facts() -> None:
    tree = TransformTree()
    fill(tree, END_NS)
    stamp_ns = END_NS + 80 * MS
    found = tree.estimate_transform("map", "tool", stamp_ns)
    for limit in ({"max_error_m": found.error_m / 2}, {"max_error_rad": found.error_rad / 2}):
        with pytest.raises(TooUncertain, match="most of it comes from the link") as caught:
            tree.estimate_transform("map", "tool", stamp_ns, **limit)
        error = caught.value
        assert (error.error_m, error.error_rad) == (found.error_m, found.error_rad)
        assert (error.parent_frame, error.frame) == found.limiting_link
        assert error.limit == pytest.approx(next(iter(limit.values())))
        assert error.by_ns == 80 * MS
        assert pickle.loads(pickle.dumps(error)).facts == error.facts
    exact = {"max_error_m": found.error_m, "max_error_rad": found.error_rad}
    assert tree.estimate_transform("map", "tool", stamp_ns, **exact) == found


def test_errors_are_those_of_lookups() -> None:
    tree = TransformTree()
    fill(tree, END_NS)
    cases = [
        (LookupException, ("map", "nobody", END_NS)),
        (LookupException, ("nobody", "map", END_NS)),
        (ConnectivityException, ("map", "flag", END_NS)),
        (BackwardExtrapolationException, ("map", "tool", END_NS - 20 * S)),
        (ForwardExtrapolationException, ("map", "tool", END_NS + 501 * MS)),
    ]
    for kind, question in cases:
        with pytest.raises(kind):
            tree.estimate_transform(*question)
    with pytest.raises(ForwardExtrapolationException) as caught:
        tree.estimate_transform("base", "tool", END_NS + 501 * MS)
    error = caught.value
    assert (error.parent_frame, error.frame) == ("base", "arm")
    assert (error.newest_stamp_ns, error.stamp_ns) == (END_NS, END_NS + 501 * MS)
    assert tree.estimate_transform("base", "tool", END_NS + 501 * MS, max_by_s=0.6)


def test_reparented_frames_use_the_history_of_their_parent() -> None:
    tree = moving(circle)
    put(tree, lambda _: Transform((7, 0, 0)), [END_NS + 50 * MS, END_NS + 100 * MS], parent="dock")
    tree.set_transform(StampedTransform("map", "dock", 0, Transform((1, 0, 0))), static=True)
    found = tree.estimate_transform("map", "base", END_NS + 150 * MS)
    assert off(found, Transform((8, 0, 0))) < 1e-9
    assert found.backtests == 0 and found.limiting_link in {None, ("dock", "base")}
    with_map = tree.estimate_transform("map", "base", END_NS - 25 * MS)
    assert off(with_map, circle(-0.025)) < 0.01 and with_map.backtests > 9
    put(tree, circle, range(END_NS + 200 * MS, END_NS + 6 * S, 50 * MS))
    later = tree.estimate_transform("map", "base", END_NS + 6 * S)
    assert off(later, circle(6)) < 1e-6 and later.backtests > 9 and later.error_m < 0.01


def test_repeated_poses_count_from_their_first_stamp() -> None:
    """A localiser measures at 5 Hz, and repeats its last pose at 50 Hz, stamped 100 ms ahead."""

    def measured(stamp_ns: int) -> Transform:
        return Transform(((stamp_ns - stamp_ns % (200 * MS) - END_NS) * 1e-9, 0, 0))

    tree, plain = TransformTree(), TransformTree()
    for stamp_ns in range(END_NS - 9 * S, END_NS + 80 * MS, 20 * MS):
        tree.set_transform(StampedTransform("map", "base", stamp_ns + 100 * MS, measured(stamp_ns)))
    put(plain, lambda seconds: Transform((seconds, 0, 0)), range(END_NS - 9 * S, END_NS, 20 * MS))
    stamp_ns = END_NS + 150 * MS  # measured 150 ms before, and published as of END + 160 ms
    found = tree.estimate_transform("map", "base", stamp_ns)
    assert found.by_ns == 0 and found.predictor == {}
    assert 0.19 < found.error_m < 0.21
    assert plain.estimate_transform("map", "base", END_NS - 30 * MS).error_m < 1e-6


def test_stamps_ahead_of_the_clock_have_errors() -> None:
    """At 1 m/s, stamps that are 100 ms ahead hide 10 cm."""
    now_ns = time.time_ns()
    tree = TransformTree()
    tree.set_transforms_xact(
        [
            StampedTransform("map", "base", stamp_ns, Transform(((stamp_ns - now_ns) * 1e-9, 0, 0)))
            for stamp_ns in range(now_ns - 9 * S, now_ns + 100 * MS, 10 * MS)
        ]
    )
    ask = tree._estimate_record
    ahead = ask("map", "base", now_ns, now_ns, 0.9, 500 * MS, 0.0)
    assert 0.08 < ahead["error_m"] < 0.15
    later = ask("map", "base", now_ns, now_ns + S, 0.9, 500 * MS, 0.0)
    assert later["error_m"] < 1e-6


def test_many_rows() -> None:
    tree = TransformTree()
    fill(tree, END_NS)
    sources = ["tool", "nobody", "flag", "base"]
    found = tree.estimate_transforms("map", sources, END_NS + 30 * MS, level=0.8)
    assert found.status.tolist() == [0, 2, 3, 0] and found.ok.tolist() == [True, False, False, True]
    assert len(found) == 4
    assert repr(found) == (
        "EstimateArray(4 rows, 2 failed with LookupException, ConnectivityException)"
    )
    assert np.isnan(found.poses[1:3]).all() and np.isnan(found.error_m[1:3]).all()
    for row, source in ((0, "tool"), (3, "base")):
        one = tree.estimate_transform("map", source, END_NS + 30 * MS, level=0.8)
        assert found.poses[row].tolist() == list(one.transform.pose())
        assert (found.error_m[row], found.error_rad[row]) == (one.error_m, one.error_rad)
        assert (found.level[row], found.backtests[row]) == (one.level, one.backtests)
        assert found.by_ns[row] == 30 * MS
    now = tree.estimate_transforms("arm", ["tool"], None)
    assert now.ok.all() and abs(int(now.stamps_ns[0]) - time.time_ns()) < 60 * S
    assert len(tree.estimate_transforms([], [], [])) == 0
    with pytest.raises(InvalidArgumentException):
        tree.estimate_transforms("map", ["tool", "base"], [1, 2, 3])


@pytest.mark.parametrize("concurrency", CONTROLS)
def test_estimates_of_concurrent_commits_are_consistent(concurrency: Any) -> None:
    """Two links move in opposite directions, so that the tool stands still in every state."""
    tree = TransformTree(concurrency=concurrency)

    def commit(stamp_ns: int) -> None:
        x = (stamp_ns - END_NS) * 1e-9
        tree.set_transforms_xact(
            [
                StampedTransform("map", "base", stamp_ns, Transform((x, 0, 0))),
                StampedTransform("base", "tool", stamp_ns, Transform((5 - x, 0, 0))),
            ]
        )

    for stamp_ns in range(END_NS - 3 * S, END_NS + 1, 10 * MS):
        commit(stamp_ns)
    newest, stop = [END_NS], threading.Event()

    def write() -> None:
        while not stop.is_set():
            newest[0] += 10 * MS
            commit(newest[0])
            time.sleep(0.0005)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for i in range(300):
            found = tree.estimate_transform("map", "tool", newest[0] + i % 50 * MS, max_by_s=2.0)
            assert found.transform.translation == pytest.approx((5, 0, 0), abs=1e-6)
            assert found.error_m < 1e-6 and 0.5 < found.level <= 1
    finally:
        stop.set()
        writer.join()


def test_an_estimate_is_a_value() -> None:
    tree = moving(lambda seconds: Transform((seconds, 0, 0)))
    first, same = (tree.estimate_transform("map", "base", END_NS + 50 * MS) for _ in range(2))
    assert first == same and hash(first) == hash(same)
    assert first != tree.estimate_transform("map", "base", END_NS + 60 * MS)
    assert pickle.loads(pickle.dumps(first)) == copy.copy(first) == first
    assert eval(repr(first)) == first
    assert first.predictor == {"base": "twist"}
    with pytest.raises(AttributeError):
        first.error_m = 0.0  # type: ignore[misc]
