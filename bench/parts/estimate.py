"""How often the truth is within an estimate's bounds, and what an estimate costs."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

import numpy as np

from bench.report import Report, Trial
from bench.trajectories import (
    AT_REST,
    LOSING,
    SCENARIOS,
    STARTS_EVERY_S,
    Array,
    Scenario,
    base_and_arm,
    errors,
    nanoseconds,
)
from zenoh_tf import TransformException

LEVELS = (0.9, 0.99, 0.999)
#: 0.999 needs ten minutes of history.
HISTORY_S, ASKED_S, QUESTIONS, SEEDS = 620.0, 120.0, 1_400, 3
#: Errors below 2 mm count as 2 mm in ratios of medians: nobody needs a bound below that.
LEAST_M = 0.002


#: What is declared of the base's motion and of the clock of its samples.
SYSTEMS: dict[str, dict[str, float]] = {
    "estimate": {},
    "estimate, limits": dict.fromkeys(("max_speed_m_s", "max_accel_m_s2", "max_rate_rad_s"), 1.0)
    | {"max_rate_accel_rad_s2": 2.0},
    "estimate, clock": {"max_clock_error_s": 0.02},
}


def ask(
    scenario: Scenario,
    times_s: Array,
    levels: tuple[float, ...],
    history_s: float = HISTORY_S,
    limits: Mapping[str, float] | None = None,
    children: Iterable[str] = ("base",),
) -> dict[float, Array]:
    """Ask for each time when it is now, with what has arrived by then. The columns are the errors
    in metres and radians, their bounds, and the level that was reached. `limits` are declared of
    the motion of these children."""
    tree = scenario.prepare(history_s)
    if limits:
        for child in children:
            tree.set_motion_limits(child, **limits)
    poses, bounds = [], []
    for time_s, stamp_ns in zip(times_s, nanoseconds(times_s), strict=True):
        scenario.feed(tree, time_s)
        for level in levels:
            try:
                e = tree.estimate_transform(*scenario.ends, stamp_ns, level=level, max_by_s=1.0)
            except TransformException as error:
                raise SystemExit(f"{scenario.name} at {time_s} s: {error}") from None
            poses.append(e.transform.pose())
            bounds.append((e.error_m, e.error_rad, e.level))
    truth = np.repeat(scenario.truth(times_s), len(levels), axis=0)
    found = np.column_stack([*errors(np.array(poses), truth), bounds])
    return {level: found[i :: len(levels)] for i, level in enumerate(levels)}


def within(found: Array) -> Array:
    """Whether the truth is within both bounds, by answer of `ask`."""
    return np.asarray((found[:, :2] <= found[:, 2:4]).all(axis=1))


def measure(report: Report) -> None:
    """Coverage beside what is usual, and times beside a lookup's."""
    history_s, asked_s, questions, seeds = HISTORY_S, ASKED_S, QUESTIONS, SEEDS
    if report.quick:
        history_s, asked_s, questions, seeds = 12.0, 2.0, 20, 1
    begin_s, end_s = history_s + 5, history_s + 5 + asked_s
    for name, make in SCENARIOS.items():
        answers, usual = [], []
        for seed in range(seeds):
            rng = np.random.default_rng([seed, len(name)])
            scenario = Scenario(name, make(rng, end_s + 1))
            times_s = np.sort(rng.uniform(begin_s, end_s, questions))
            answers.append(ask(scenario, times_s, LEVELS, history_s))
            carried = (scenario.carried(times_s, twist) for twist in (False, True))
            usual.append([errors(each, scenario.truth(times_s))[0] for each in carried])
        for level in LEVELS:
            found = np.concatenate([each[level] for each in answers])
            _add(report, name, level, found, np.concatenate(usual, axis=1))
    _lose(report)
    _time(report)


def _add(report: Report, name: str, level: float, found: Array, usual: Array) -> None:
    """Ours, then the tolerance of what is usual that would have held for as many."""
    labels, row = {"scenario": name, "level": level}, _judged(found)
    attained = float(found[:, 4].mean())
    report.add(labels | {"system": "estimate"}, row | {"attained": attained})
    for system, metres in zip(("hold", "twist"), usual, strict=True):
        tolerance = float(np.quantile(metres, (found[:, 0] <= found[:, 2]).mean()))
        trial = {"bound_mm": 1e3 * tolerance, "error_mm": 1e3 * float(np.median(metres))}
        report.add(labels | {"system": system}, trial)
    if report.quick:
        return
    limit = 100 * (1 - attained)
    report.target(f"{name}: % outside at {level:g}", [row["outside_percent"]], "<=", limit)
    if level == LEVELS[0]:
        report.target(f"{name}: bound to error", [row["bound_to_error"]], "<=", 3)


def _judged(found: Array) -> Trial:
    """The share outside, medians, and the bound that knows the errors: their 90 %."""
    error, p90 = (float(np.quantile(found[:, 0], share)) for share in (0.5, 0.9))
    bound = float(np.median(found[:, 2]))
    return {
        "outside_percent": 100 * (1 - float(within(found).mean())),
        "bound_mm": 1e3 * bound,
        "error_mm": 1e3 * error,
        "error_mm_p90": 1e3 * p90,
        "bound_to_error": bound / max(error, LEAST_M),
    }


def _lose(report: Report) -> None:
    """What history cannot know, and what declared limits change."""
    seconds, questions = (40.0, 20) if report.quick else (400.0, 1_000)
    for name, make in LOSING.items():
        rng = np.random.default_rng(7)
        scenario = Scenario(name, make(rng, seconds))
        times_s = np.sort(rng.uniform(20, seconds - STARTS_EVERY_S, questions))
        if name == AT_REST:
            drives_s = STARTS_EVERY_S * np.ceil(times_s / STARTS_EVERY_S) - 3
            times_s = np.sort(drives_s + rng.uniform(0, 0.3, questions))
        for system, limits in SYSTEMS.items():
            found = ask(scenario, times_s, LEVELS[:1], 10.0, limits)[LEVELS[0]]
            labels = {"scenario": name, "level": LEVELS[0], "system": system}
            report.add(labels, _judged(found))
    scenario = Scenario("a start and a stop", LOSING[AT_REST](np.random.default_rng(7), 60.0))
    times_s = np.arange(-1, 5, 2.0 if report.quick else 0.125) + 2 * STARTS_EVERY_S - 3
    for system, limits in SYSTEMS.items():
        found = ask(scenario, times_s, LEVELS[:1], 10.0, limits)[LEVELS[0]]
        labels = {"scenario": scenario.name, "level": LEVELS[0], "system": system}
        for time_s, (error, _, bound, *_) in zip(times_s, 1e3 * found, strict=True):
            at_s = round(float(time_s) - 2 * STARTS_EVERY_S + 3, 3)
            report.add(labels | {"seconds": at_s}, {"bound_mm": bound, "error_mm": error})


def _time(report: Report) -> None:
    """An estimate from kept residuals and the first one of a path, beside a lookup at a time."""
    scenario = Scenario("times", base_and_arm(np.random.default_rng(1), 14.0))
    tree = scenario.prepare(10.0)
    scenario.feed(tree, 12.0)
    now_ns, then_ns = nanoseconds(np.array([12.0, 11.0]))
    calls, ends = 20 if report.quick else 20_000, scenario.ends

    def looked_up() -> Trial:
        begun = time.perf_counter()
        for _ in range(calls):
            tree.lookup_transform(*ends, then_ns)
        return {"us": 1e6 * (time.perf_counter() - begun) / calls}

    def estimated() -> Trial:
        begun = time.perf_counter()
        for _ in range(calls):
            tree.estimate_transform(*ends, now_ns)
        return {"us": 1e6 * (time.perf_counter() - begun) / calls}

    def first() -> Trial:
        fresh = scenario.prepare(10.0)
        scenario.feed(fresh, 12.0)
        begun = time.perf_counter()
        fresh.estimate_transform(*ends, now_ns)
        return {"us": 1e6 * (time.perf_counter() - begun)}

    runs = {"lookup at a time": looked_up, "estimate": estimated, "first estimate": first}
    cells = report.compare({"scenario": "over 6 links"}, runs)
    values = cells["estimate"].over(cells["lookup at a time"], "us")
    report.target("estimate to lookup", values, "<=", 3)
    report.target("first estimate, us", cells["first estimate"].values("us"), "<=", 1_000)
