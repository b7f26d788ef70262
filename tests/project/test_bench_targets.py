"""How the benchmark checks its targets."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bench.parts import native
from bench.report import Cell, Report, equal_poses, quartiles, ratios

READS, WRITES, P50, P999 = "reads_per_s", "links_written_per_s", "read_us_p50", "read_us_p999"


def cell(system: str, readers: int, writers: int, **values: list[float]) -> Cell:
    labels = {"links": 1000, "direction": "opposite", "readers": readers, "writers": writers}
    labels |= {"system": system, "read": "latest-common"}
    defaults = {READS: 3 * [1.0], P50: 3 * [0.1], P999: 3 * [0.3], "operations_per_s": 3 * [1.0]}
    metrics = defaults | ({WRITES: 3 * [1.0]} if writers else {}) | values
    trials = [dict(zip(metrics, row, strict=True)) for row in zip(*metrics.values(), strict=True)]
    return Cell(labels, trials=trials)


@pytest.fixture
def check() -> Callable[..., dict[str, bool]]:
    def checked(*cells: Cell, cores: int = 2) -> dict[str, bool]:
        report = Report()
        native.check_paper(report, cells, cores)
        return {
            f"{row['name'].partition(': ')[2]} {row['wanted']}": row["reached"]
            for row in report.targets
        }

    return checked


def test_ratios_are_trial_by_trial() -> None:
    assert ratios([10.0, 20.0, 30.0], [1.0, 10.0, 2.0]) == [10.0, 2.0, 15.0]
    assert ratios([10.0, 20.0], [0.0, 10.0]) == [2.0]
    assert ratios([10.0, float("nan")], [5.0, 1.0]) == [2.0]


def test_quartiles_are_of_what_was_measured() -> None:
    assert quartiles([float("nan"), 5.0, 1.0, 2.0, 3.0, 4.0]) == [2.0, 3.0, 4.0]
    assert quartiles([7.0]) == [7.0, 7.0, 7.0]
    assert quartiles([float("nan")]) == []


def test_answers_are_equal_up_to_the_rotations_sign() -> None:
    pose, stamp = [1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5], [7.0]
    turned = pose[:3] + [-value for value in pose[3:]]
    assert equal_poses(pose + stamp, turned + stamp)
    assert not equal_poses(pose + stamp, [*pose, 8.0])
    assert not equal_poses(pose, [1.0, 2.0, 3.1, *pose[3:]])
    assert not equal_poses(pose, [-1.0, -2.0, -3.0, *turned[3:]])
    assert not equal_poses(pose, [float("nan"), *pose[1:]])


def test_target_compares_the_median() -> None:
    report = Report()
    for sign, limit in ((">=", 2), (">=", 2.1), ("<=", 2), ("<=", 1.9)):
        report.target("", [1.0, 2.0, 90.0], sign, limit)
    report.target("nothing measured", [], ">=", 1)
    assert [target["reached"] for target in report.targets] == [True, False, True, False]


def test_beside_tf2(check: Callable[..., dict[str, bool]]) -> None:
    ours = cell("optimistic", 1, 1, **{READS: [11.0, 12.0, 90.0], WRITES: [119.0] * 3})
    reached = check(ours, cell("tf2", 1, 1))
    assert reached["reads to tf2's >= 12"]
    assert not reached["link writes to tf2's >= 120"]
    assert not reached["read p99.9 to tf2's p50 <= 1"]
    slow = cell("tf2", 1, 1, **{P50: [0.3] * 3, P999: [1e3] * 3})
    assert check(ours, slow)["read p99.9 to tf2's p50 <= 1"]
    assert check(ours) == {}  # without tf2 nothing can be said
