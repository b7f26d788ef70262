"""Figures measured by turns with what they are compared to, and their table."""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass
from typing import Any

#: Of every figure; what is compared is measured in pairs, one after the other.
REPETITIONS = 7


@dataclass(frozen=True)
class Bar:
    """What a figure must reach: its median, or the median ratio to the other's."""

    limit: float
    at_least: bool = False  # else at most
    ratio: bool = False

    def reached(self, figure: Figure) -> bool:
        value = statistics.median(figure.ratios if self.ratio else figure.ours)
        return value >= self.limit if self.at_least else value <= self.limit

    def __str__(self) -> str:
        sign = ">=" if self.at_least else "<="
        return f"{'ratio ' if self.ratio else ''}{sign} {self.limit:,g}"


@dataclass(frozen=True)
class Figure:
    """One thing measured, a value for each repetition; equal repetitions are neighbours in time."""

    name: str
    unit: str
    ours: list[float]
    other_name: str | None = None
    other: list[float] | None = None
    bar: Bar | None = None

    @property
    def ratios(self) -> list[float]:
        """Ours to the other's, pair by pair."""
        return [ours / other for ours, other in zip(self.ours, self.other or [], strict=True)]

    def as_dict(self) -> dict[str, Any]:
        record = {key: value for key, value in asdict(self).items() if value is not None}
        if self.bar is not None:
            record["reached"] = self.bar.reached(self)
        return record

    def line(self) -> str:
        """Name, ours, the other's, ratio, bar; medians, with the lowest and highest."""
        cells = [f"{self.name:<40}", f"{_spread(self.ours):>32} {self.unit:<4}"]
        if self.other:
            cells.append(f"{self.other_name} {statistics.median(self.other):,.4g}")
            cells.append(f"ratio {_spread(self.ratios)}")
        if self.bar is not None:
            cells.append(f"bar {self.bar}: {'reached' if self.bar.reached(self) else 'MISSED'}")
        return "  ".join(cells)


def _spread(values: list[float]) -> str:
    low, middle, high = min(values), statistics.median(values), max(values)
    if middle >= 1000:
        return f"{middle:,.0f} [{low:,.0f}-{high:,.0f}]"
    return f"{middle:.3g} [{low:.3g}-{high:.3g}]"
