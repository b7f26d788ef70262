"""How often the truth is within an estimate's bounds, and what an estimate costs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.report import Report, Trial
from bench.scenarios import AT_REST, LOSING, SCENARIOS, base_and_arm
from bench.trajectories import STARTS_EVERY_S, Array, Scenario, errors, nanoseconds
from zenoh_tf import TransformException, TransformTree

LEVELS = (0.9, 0.99, 0.999)
#: 0.999 needs ten minutes of history.
HISTORY_S, ASKED_S, QUESTIONS, SEEDS = 620.0, 120.0, 1_400, 3
#: Errors below 2 mm count as 2 mm in ratios of medians: nobody needs a bound below that.
LEAST_M = 0.002


def _limited(tree: TransformTree) -> None:
    tree.set_motion_limits(
        "base",
        max_speed_m_s=1.0,
        max_accel_m_s2=1.0,
        max_rate_rad_s=1.0,
        max_rate_accel_rad_s2=2.0,
    )


SYSTEMS = {"estimate": lambda _: None, "estimate, limits": _limited}


@dataclass
class Answers:
    """What was found for the questions that had an answer."""

    scenario: Scenario
    times_s: Array
    poses: Array
    bounds: Array  # (n, 2) metres, radians
    levels: Array

    @property
    def errors(self) -> tuple[Array, Array]:
        return errors(self.poses, self.scenario.truth(self.times_s))

    @property
    def within(self) -> Array:
        metres, radians = self.errors
        return np.asarray((metres <= self.bounds[:, 0]) & (radians <= self.bounds[:, 1]))


def ask(
    scenario: Scenario,
    times_s: Array,
    levels: tuple[float, ...],
    history_s: float = HISTORY_S,
    prepare: Callable[[TransformTree], None] = lambda _: None,
) -> dict[float, Answers]:
    """Ask for each time when it is now, with what has arrived by then."""
    tree = scenario.prepare(history_s)
    rows: dict[float, list[tuple[float, ...]]] = {level: [] for level in levels}
    prepare(tree)
    for time_s, stamp_ns in zip(times_s, nanoseconds(times_s), strict=True):
        scenario.feed(tree, time_s)
        for level in levels:
            try:
                e = tree.estimate_transform(*scenario.ends, stamp_ns, level=level, max_by_s=1.0)
            except TransformException as error:
                raise SystemExit(f"{scenario.name} at {time_s} s: {error}") from None
            rows[level].append((time_s, *e.transform.pose(), e.error_m, e.error_rad, e.level))
    columns = {level: np.array(each) for level, each in rows.items()}
    return {
        level: Answers(scenario, each[:, 0], each[:, 1:8], each[:, 8:10], each[:, 10])
        for level, each in columns.items()
    }


def measure(report: Report) -> None:
    """Coverage beside what is usual, and times beside a lookup's."""
    history_s, asked_s, questions = HISTORY_S, ASKED_S, QUESTIONS
    if report.quick:
        history_s, asked_s, questions = 12.0, 2.0, 20
    begin_s, end_s = history_s + 5, history_s + 5 + asked_s
    for name, make in SCENARIOS.items():
        seeds = []
        for seed in range(1 if report.quick else SEEDS):
            rng = np.random.default_rng([seed, len(name)])
            scenario = Scenario(name, make(rng, end_s + 1))
            times_s = np.sort(rng.uniform(begin_s, end_s, questions))
            seeds.append(ask(scenario, times_s, LEVELS, history_s))
        for level in LEVELS:
            _add(report, name, level, [each[level] for each in seeds])
    _lose(report)
    _time(report)


def _add(report: Report, name: str, level: float, seeds: list[Answers]) -> None:
    """Ours, then the tolerance of what is usual that would have held for as many."""
    labels = {"scenario": name, "level": level}
    metres = np.concatenate([found.errors[0] for found in seeds])
    bounds = np.concatenate([found.bounds[:, 0] for found in seeds])
    row = _judged(metres, np.concatenate([found.within for found in seeds]), bounds)
    attained = float(np.mean([found.levels.mean() for found in seeds]))
    report.add(labels | {"system": "estimate"}, row | {"attained": attained})
    for system in ("hold", "twist"):
        apart = np.concatenate([_usual(found, system == "twist") for found in seeds])
        tolerance = float(np.quantile(apart, (metres <= bounds).mean()))
        usual = {"bound_mm": 1e3 * tolerance, "error_mm": 1e3 * float(np.median(apart))}
        report.add(labels | {"system": system}, usual)
    if report.quick:
        return
    limit = 100 * (1 - attained)
    report.target(f"{name}: % outside at {level:g}", [row["outside_percent"]], "<=", limit)
    if level == LEVELS[0]:
        report.target(f"{name}: bound to error", [row["bound_to_error"]], "<=", 3)


def _judged(metres: Array, within: Array, bounds: Array) -> Trial:
    """The share outside, medians, and the bound that knows the errors: their 90 %."""
    error, p90 = (float(np.quantile(metres, share)) for share in (0.5, 0.9))
    bound = float(np.median(bounds))
    row = {"outside_percent": 100 * (1 - float(within.mean())), "bound_mm": 1e3 * bound}
    row |= {"error_mm": 1e3 * error, "error_mm_p90": 1e3 * p90}
    return row | {"bound_to_error": bound / max(error, LEAST_M)}


def _usual(found: Answers, twist: bool) -> Array:
    carried = found.scenario.carried(found.times_s, twist)
    return errors(carried, found.scenario.truth(found.times_s))[0]


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
        for system, prepare in SYSTEMS.items():
            found = ask(scenario, times_s, LEVELS[:1], 10.0, prepare)[LEVELS[0]]
            row = _judged(found.errors[0], found.within, found.bounds[:, 0])
            report.add({"scenario": name, "level": LEVELS[0], "system": system}, row)
    scenario = Scenario("a start and a stop", LOSING[AT_REST](np.random.default_rng(7), 60.0))
    times_s = np.arange(-1, 5, 2.0 if report.quick else 0.125) + 2 * STARTS_EVERY_S - 3
    for system, prepare in SYSTEMS.items():
        found = ask(scenario, times_s, LEVELS[:1], 10.0, prepare)[LEVELS[0]]
        for time_s, bound, error in zip(times_s, found.bounds, found.errors[0], strict=True):
            labels = {"scenario": scenario.name, "level": LEVELS[0], "system": system}
            at_s = round(float(time_s) - 2 * STARTS_EVERY_S + 3, 3)
            report.add(
                labels | {"seconds": at_s}, {"bound_mm": 1e3 * bound[0], "error_mm": 1e3 * error}
            )


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
