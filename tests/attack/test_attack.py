"""The measures of the attack tool; the attacks are `make attack`."""

from __future__ import annotations

import math

from .arena import Finding, failures, outage_ms, p99_ms
from .processes import Call


def _calls(*ends_s: float) -> list[Call]:
    return [Call(end_s - 0.01, end_s, "ok", 0.0) for end_s in ends_s]


def test_an_outage_is_the_longest_time_without_a_success() -> None:
    calls = [*_calls(1.0, 1.1, 1.2, 2.0, 2.1), Call(1.3, 1.5, "ServerUnavailable", 0.0)]
    assert math.isclose(outage_ms(calls, 1.0, 2.1, 0.1), 700)
    assert math.isclose(outage_ms(calls, 1.0, 1.2, 0.1), 0, abs_tol=1e-6)
    assert math.isclose(outage_ms([], 0.0, 3.0, 0.1), 2900)
    assert failures(calls, 1.0, 2.0) == 1


def test_an_outage_that_lasts_beyond_the_window_counts() -> None:
    assert math.isclose(outage_ms(_calls(1.0, 1.1, 9.0), 1.0, 5.0, 0.1), 3800)


def test_a_percentile_counts_calls_that_failed() -> None:
    calls = [Call(0.0, 1.0, "ServerUnavailable", 0.0)]
    assert p99_ms(calls, 0.0, 2.0) == 1000
    assert math.isnan(p99_ms(calls, 5.0, 6.0))


def test_what_was_not_measured_is_not_kept() -> None:
    assert Finding("x", 1.0, "ms", 1.0).kept
    assert not Finding("x", 1.1, "ms", 1.0).kept
    assert not Finding("x", math.nan, "ms", 1.0).kept
