"""How the benchmark judges its table: ratios turn by turn, and which bar is for which cell."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.paper_bars import Table, judge, middle, ratios

RESULTS = Path(__file__).parents[1] / "bench" / "results"


def cell(side: str, readers: int, writers: int, **values: Any) -> dict[str, Any]:
    percentiles = {"p50": [100.0], "p99": [200.0], "p999": [300.0]}
    row = {
        "links": 1000,
        "direction": "opposite",
        "readers": readers,
        "writers": writers,
        "cache_s": 1.0,
        "samples": 64,
        "pinned": True,
        "side": side,
        "read": "latest-common",
        "reads_per_s": [1.0, 1.0, 1.0],
        "writes_per_s": [1.0, 1.0, 1.0],
        "links_written_per_s": [1.0, 1.0, 1.0],
        "read_ns": percentiles,
        "write_ns": percentiles,
    }
    once = ("unanswered_share", "restarts_per_read", "restarts_per_write", "others_cores")
    row |= {name: [0.0] for name in (*once, "round_trip_ns", "delay_oldest_s", "delay_mean_s")}
    return row | values


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[str, bool]]:
    monkeypatch.setattr("os.cpu_count", lambda: 2)

    def bars(*cells: dict[str, Any]) -> dict[str, bool]:
        return {bar["bar"]: bar["reached"] for bar in judge(Table(cells))}

    return bars


def test_ratios_are_turn_by_turn() -> None:
    assert ratios([10.0, 20.0, 30.0], [1.0, 10.0, 2.0]) == [10.0, 2.0, 15.0]
    assert ratios([10.0, 20.0], [0.0, 10.0]) == [2.0]
    assert middle([None, 3.0, 1.0, 2.0]) == 2.0
    assert middle([None]) != middle([None])


def test_beside_tf2(judged: Callable[..., dict[str, bool]]) -> None:
    ours = cell("optimistic", 1, 1, reads_per_s=[11.0, 12.0, 90.0], links_written_per_s=[119.0] * 3)
    name = "1 reader, 1 writer, 1,000 links, latest-common:"
    bars = judged(ours, cell("tf2", 1, 1))
    assert bars[f"{name} reads to tf2's >= 12"]
    assert not bars[f"{name} link writes to tf2's >= 120"]
    assert not bars[f"{name} read p99.9 to tf2's p50 <= 1"]
    slow = cell("tf2", 1, 1, read_ns={"p50": [300.0], "p99": [1e6], "p999": [1e6]})
    assert judged(ours, slow)[f"{name} read p99.9 to tf2's p50 <= 1"]
    assert not judged(ours)  # without tf2 nothing can be said


def test_more_threads(judged: Callable[..., dict[str, bool]]) -> None:
    few, many = cell("optimistic", 1, 1), cell("optimistic", 4, 4, reads_per_s=[0.7, 0.7, 0.9])
    bars = judged(few, many)
    where = "half readers, 1,000 links, latest-common:"
    assert not bars[f"{where} reads, 8 threads to 2 >= 0.8"]
    assert bars[f"{where} writes, 8 threads to 2 >= 0.8"]
    one, two = cell("optimistic", 1, 0), cell("optimistic", 2, 0, reads_per_s=[1.95] * 3)
    assert judged(one, two) == {
        "read-only, 1,000 links, latest-common: 2 threads to 1 >= 1.9": True
    }


def test_beside_2pl(judged: Callable[..., dict[str, bool]]) -> None:
    bars = judged(cell("optimistic", 2, 0), cell("2pl", 2, 0, reads_per_s=[1.1] * 3))
    assert bars == {"2 readers, 0 writers, 1,000 links, latest-common: reads to 2pl's >= 1": False}


@pytest.mark.parametrize("file", sorted(RESULTS.glob("core-*.json")), ids=lambda file: file.stem)
def test_kept_results_can_be_read(file: Path) -> None:
    table = Table.of(json.loads(file.read_text())["paper"])
    assert {row.side for row in table.rows} == {"optimistic", "2pl", "giant", "tf2"}
