"""Trials by turns, their medians and quartiles, the targets, and the results file of a part."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: What one trial measured, by metric.
Trial = dict[str, float]


@dataclass
class Cell:
    """One system in one case, by its labels."""

    labels: dict[str, Any]
    run: Callable[[], Trial] = dict
    trials: list[Trial] = field(default_factory=list)

    def values(self, metric: str) -> list[float]:
        """A value for each trial; NaN if that trial did not measure it."""
        return [trial.get(metric, math.nan) for trial in self.trials]

    def over(self, other: Cell, metric: str, theirs: str = "") -> list[float]:
        """Its ratios to another system, trial by trial."""
        return ratios(self.values(metric), other.values(theirs or metric))


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


class Report:
    """What one part measures. ``quick``: one short trial each, to see that it works."""

    def __init__(self, quick: bool = False) -> None:
        self.quick = quick
        self.rows: list[dict[str, Any]] = []
        self.targets: list[dict[str, Any]] = []

    def seconds(self, slice_s: float) -> float:
        return min(slice_s, 0.02) if self.quick else slice_s

    def compare(
        self, case: Mapping[str, Any], runs: Mapping[str, Callable[[], Trial]], repetitions: int = 9
    ) -> dict[str, Cell]:
        """Runs all systems once to warm up, then by turns; returns a cell for each."""
        cells = {name: Cell({**case, "system": name}, run) for name, run in runs.items()}
        for cell in () if self.quick else cells.values():
            cell.run()
        self.measure(list(cells.values()), repetitions)
        return cells

    def measure(self, cells: Sequence[Cell], repetitions: int = 9) -> Sequence[Cell]:
        """Runs all cells by turns, in the given order; prints, keeps and returns them."""
        self.take_turns(cells, repetitions)
        for cell in cells:
            self.add(cell.labels, *cell.trials)
        return cells

    def take_turns(self, cells: Sequence[Cell], repetitions: int) -> None:
        for _ in range(1 if self.quick else repetitions):
            for cell in cells:
                cell.trials.append(cell.run())

    def add(self, labels: Mapping[str, Any], *trials: Trial) -> None:
        """Prints and keeps the quartiles of each metric."""
        metrics = dict.fromkeys(name for trial in trials for name in trial)
        values = {name: [trial.get(name, math.nan) for trial in trials] for name in metrics}
        found = {name: quartiles(each) for name, each in values.items() if quartiles(each)}
        self.rows.append({**labels, "trials": len(trials)} | found)
        print(", ".join(str(label) for label in labels.values()))
        for name, each in found.items():
            print(f"    {name:<28} {_text(each)}", flush=True)

    def target(self, name: str, values: Sequence[float], sign: str, limit: float) -> None:
        """The median of the values must be ">=" or "<=" the limit. Nothing is kept of no values."""
        if found := quartiles(values):
            reached = found[1] >= limit if sign == ">=" else found[1] <= limit
            print(f"{'reached' if reached else 'MISSED'} {name} {sign} {limit:,g}: {_text(found)}")
            row = {"name": name, "wanted": f"{sign} {limit:,.3g}", "found": found}
            self.targets.append(row | {"reached": reached})

    def write(self, path: Path, header: dict[str, Any]) -> None:
        """The header, then one case of a system a line: its labels, then its metrics, each as
        quartiles, or as one number if these are equal."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        metrics = [n for n in names if any(isinstance(row.get(n), list) for row in self.rows)]
        labels = [name for name in names if name not in metrics]
        rows = [[row.get(name) for name in labels + metrics] for row in self.rows]
        header = header | {"labels": labels, "metrics": metrics}
        lines = [f" {json.dumps(name)}: {json.dumps(value)}" for name, value in header.items()]
        for name, items in (("rows", rows), ("targets", self.targets)):
            texts = [json.dumps(_rounded(item), separators=(",", ":")) for item in items]
            lines.append(f' "{name}": [\n' + ",\n".join(f"  {text}" for text in texts) + "\n ]")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def _rounded(value: Any) -> Any:
    """Floats with three significant digits, without a point where that is exact; equal quartiles
    as one number."""
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    if isinstance(value, list):
        items = [_rounded(item) for item in value]
        return items[0] if len(items) == 3 and len({*map(repr, items)}) == 1 else items
    if isinstance(value, float):
        value = float(f"{value:.3g}")
        return int(value) if value.is_integer() else value
    return value


def _text(values: list[float]) -> str:
    """The median, [the quartiles]."""
    texts = [f"{value / 1e6:.3g}M" if value >= 1e6 else f"{value:,.4g}" for value in values]
    return f"{texts[1]} [{texts[0]}-{texts[2]}]" if len({*texts}) > 1 else texts[0]
