"""Trials by turns, their medians and quartiles, the targets, and the results file."""

from __future__ import annotations

import itertools
import json
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: What one trial measured, by metric.
Trial = dict[str, float]


def _rounded(values: list[float]) -> list[float]:
    return [float(f"{value:.4g}") for value in values]


@dataclass
class Cell:
    """One system in one case; cells with equal labels are compared with each other."""

    labels: dict[str, Any]
    system: str
    read: str = ""
    run: Callable[[], Trial] = dict
    trials: list[Trial] = field(default_factory=list)

    def values(self, metric: str) -> list[float]:
        """A value for each trial; NaN if that trial did not measure it."""
        return [trial.get(metric, math.nan) for trial in self.trials]

    def record(self, part: str, base: Cell | None) -> dict[str, Any]:
        """Medians and quartiles; of rates and durations also their ratios to another cell's."""
        record = {"part": part, **self.labels, "system": self.system}
        record |= {"read": self.read} if self.read else {}
        record["trials"] = len(self.trials)
        for metric in dict.fromkeys(name for trial in self.trials for name in trial):
            values = self.values(metric)
            record[metric] = _rounded(quartiles(values))
            if base and base is not self and metric.endswith(("_per_s", "us_per_call")):
                to_base = ratios(values, base.values(metric))
                record[f"{metric}_to_{base.system}"] = _rounded(quartiles(to_base))
        return {name: value for name, value in record.items() if value != []}


def ratios(ours: Iterable[float], theirs: Iterable[float]) -> list[float]:
    """Trial by trial, because neighbours in time ran under equal conditions."""
    return [a / b for a, b in zip(ours, theirs, strict=True) if b and not math.isnan(a / b)]


def quartiles(values: Iterable[float]) -> list[float]:
    """First quartile, median and third quartile of what was measured; empty if nothing was."""
    known = [value for value in values if not math.isnan(value)]
    return statistics.quantiles(known, n=4, method="inclusive") if len(known) > 1 else 3 * known


def equal_poses(ours: list[float], theirs: list[float]) -> bool:
    """Within 1e-9, and up to the rotation's sign; what follows a pose must be equal."""
    dot = sum(a * b for a, b in zip(ours[3:7], theirs[3:7], strict=True))
    signed = theirs[:3] + [math.copysign(1, dot) * value for value in theirs[3:7]]
    near = all(abs(a - b) <= 1e-9 for a, b in zip(ours[:7], signed, strict=True))
    return near and ours[7:] == theirs[7:]


@dataclass(frozen=True)
class Target:
    """The median of these values must reach the limit."""

    name: str
    limit: float
    values: Sequence[float]
    at_least: bool = True

    @property
    def reached(self) -> bool:
        median = quartiles(self.values)[1]
        return median >= self.limit if self.at_least else median <= self.limit


class Report:
    """All that is measured in this run. ``quick``: one short trial each, to see that it works."""

    def __init__(self, machine: dict[str, str], quick: bool = False) -> None:
        self.machine = machine
        self.quick = quick
        self.cells: list[dict[str, Any]] = []
        self.targets: list[dict[str, Any]] = []

    def repetitions(self, count: int = 9) -> int:
        return 1 if self.quick else count

    def seconds(self, slice_s: float) -> float:
        return min(slice_s, 0.02) if self.quick else slice_s

    def measure(
        self, part: str, cells: Sequence[Cell], repetitions: int, baseline: str = "tf2"
    ) -> None:
        """Runs all cells by turns, in the given order; prints and keeps them."""
        for _ in range(repetitions):
            for cell in cells:
                cell.trials.append(cell.run())
        for labels, cells_of_case in itertools.groupby(cells, lambda cell: cell.labels):
            group = list(cells_of_case)
            base = next((cell for cell in group if cell.system == baseline), None)
            records = [cell.record(part, base) for cell in group]
            self.cells += records
            _print(labels, records)

    def check(self, part: str, targets: Iterable[Target]) -> None:
        """Prints and keeps those targets that have values."""
        for target in targets:
            if found := quartiles(target.values):
                name = f"{target.name} {'>=' if target.at_least else '<='} {target.limit:,g}"
                verdict = "reached" if target.reached else "MISSED"
                print(f"{verdict:<8}{name}: {found[1]:.4g}", flush=True)
                row = {"part": part, "target": name, "median": float(f"{found[1]:.4g}")}
                self.targets.append(row | {"reached": target.reached})

    def write(self, path: Path) -> None:
        """One cell a line."""
        path.parent.mkdir(parents=True, exist_ok=True)
        text = f'{{\n "machine": {json.dumps(self.machine)}'
        for name, rows in (("cells", self.cells), ("targets", self.targets)):
            text += f',\n "{name}": [\n  ' + ",\n  ".join(map(json.dumps, rows)) + "\n ]"
        path.write_text(text + "\n}\n")


def _print(labels: dict[str, Any], records: list[dict[str, Any]]) -> None:
    """Medians with quartiles, a line for each metric and system."""
    print("\n" + ", ".join(f"{key}: {value}" for key, value in labels.items()))
    measured = [key for record in records for key in record if isinstance(record[key], list)]
    for metric in dict.fromkeys(measured):
        for record in records:
            if metric in record:
                name = f"{record['system']} {record.get('read', '')}"
                print(f"{metric:<28} {name:<32} {_text(record[metric])}", flush=True)


def _text(values: list[float]) -> str:
    """The median, [the quartiles]."""
    texts = [f"{value / 1e6:.3g}M" if value >= 1e6 else f"{value:,.4g}" for value in values]
    return f"{texts[1]} [{texts[0]}-{texts[2]}]" if len({*texts}) > 1 else "".join(texts[:1])
