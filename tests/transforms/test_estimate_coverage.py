"""The truth is within an estimate's bounds as often as the estimate says: a short version of the
benchmark's part ``estimate``, with fixed seeds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.parts.estimate import SYSTEMS, ask, within
from bench.trajectories import (
    AT_REST,
    LOSING,
    SCENARIOS,
    STARTS_EVERY_S,
    Array,
    Scenario,
    driven,
    errors,
)
from tests.support import recorded
from zenoh_tf import ForwardExtrapolationException, TransformTree

QUESTIONS = 400


def check(found: Array) -> None:
    """Within the bounds at least as often as said, less three standard deviations."""
    level = float(found[:, 4].mean())
    margin = 3 * math.sqrt(level * (1 - level) / len(found))
    assert within(found).mean() >= level - margin


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_truth_is_within_the_bounds(name: str) -> None:
    rng = np.random.default_rng(5)
    scenario = Scenario(name, SCENARIOS[name](rng, 50.0))
    times_s = np.sort(rng.uniform(15, 49, QUESTIONS))
    answers = ask(scenario, times_s, (0.9, 0.99), history_s=10.0)
    check(answers[0.9])
    check(answers[0.99])
    assert np.all(answers[0.9][:, 4] == 0.9)
    # Ten seconds have too few independent residuals for 0.99, and the answers say so.
    assert np.all(answers[0.99][:, 4] < 0.99)
    # A bound that holds because it is absurd would be no use.
    assert np.median(answers[0.9][:, 2]) <= 4 * np.quantile(answers[0.9][:, 0], 0.9)


def test_a_minute_of_history_supports_a_level_of_99_percent() -> None:
    rng = np.random.default_rng(6)
    name = "sudden stops"
    scenario = Scenario(name, SCENARIOS[name](rng, 110.0))
    found = ask(scenario, np.sort(rng.uniform(70, 109, QUESTIONS)), (0.99,), history_s=70.0)[0.99]
    assert np.all(found[:, 4] == 0.99)
    check(found)


def test_history_does_not_know_a_start_but_declared_limits_do() -> None:
    rng = np.random.default_rng(7)
    scenario = Scenario(AT_REST, LOSING[AT_REST](rng, 120.0))
    starts_s = STARTS_EVERY_S * np.arange(2, 6)[:, None] - 3
    times_s = (starts_s + np.linspace(0.1, 0.3, 20)).ravel()
    history = ask(scenario, times_s, (0.9,), 10.0)[0.9]
    assert within(history).mean() < 0.9
    limits = ask(scenario, times_s, (0.9,), 10.0, SYSTEMS["estimate, limits"])[0.9]
    assert within(limits).all()


@pytest.mark.parametrize("clock_s", [0.02, -0.02])
def test_history_does_not_know_a_wrong_clock_but_its_declared_error_does(clock_s: float) -> None:
    rng = np.random.default_rng(8)
    scenario = Scenario("clock", driven(rng, 120.0, clock_s))
    times_s = np.sort(rng.uniform(15, 119, QUESTIONS))
    assert within(ask(scenario, times_s, (0.9,), 10.0)[0.9]).mean() < 0.8
    declared = ask(scenario, times_s, (0.9,), 10.0, SYSTEMS["estimate, clock"])[0.9]
    check(declared)
    assert np.median(declared[:, 2]) <= 4 * np.quantile(declared[:, 0], 0.9)


@pytest.mark.parametrize("name", SCENARIOS)
def test_declared_errors_of_all_clocks_hold(name: str) -> None:
    """Those of neighbouring links are off in opposite directions."""
    rng = np.random.default_rng(9)
    feeds = [
        replace(feed, stamps_s=feed.stamps_s + (0.02 if i % 2 else -0.02))
        for i, feed in enumerate(SCENARIOS[name](rng, 60.0))
    ]

    times_s = np.sort(rng.uniform(15, 59, QUESTIONS))
    children = [feed.child for feed in feeds]
    limits = {"max_clock_error_s": 0.02}
    declared = ask(Scenario(name, feeds), times_s, (0.9,), 10.0, limits, children)
    check(declared[0.9])


@recorded.needs_recording
@pytest.mark.parametrize("target", ["map", "odom"])
def test_a_recorded_robot_is_within_the_bounds(target: str) -> None:
    """The odometry arrives 20 to 150 ms late; the truth is what the whole recording says."""
    rng = np.random.default_rng(8)
    whole = TransformTree.from_recording(recorded.RUN)
    tree = TransformTree()
    rows = []
    begin_ns = clock_ns = 0
    for static, stampeds in recorded.transforms():
        for stamped in stampeds:
            tree.set_transform(stamped, static=static)
            if stamped.child_frame == "base_link":
                clock_ns = stamped.stamp_ns
                begin_ns = begin_ns or clock_ns
        ask_ns = clock_ns + int(rng.uniform(20e6, 150e6))
        if clock_ns < begin_ns + 15 * 10**9 or rng.random() > 0.3:
            continue
        if not whole.can_transform(target, "base_link", ask_ns):
            break
        try:
            found = tree.estimate_transform(target, "base_link", ask_ns)
        except ForwardExtrapolationException:  # the localiser was silent for half a second
            continue
        truth = whole.lookup_transform(target, "base_link", ask_ns).transform
        rows.append((*found.transform.pose(), *truth.pose(), found.error_m, found.error_rad))
    array: Array = np.array(rows)
    assert len(array) > 500
    judged = np.column_stack([*errors(array[:, :7], array[:, 7:14]), array[:, 14:]])
    assert within(judged).mean() >= 0.9 - 3 * math.sqrt(0.09 / len(array))
    if target == "odom":
        assert np.median(judged[:, 2]) <= 2 * np.quantile(judged[:, 0], 0.9)
