"""What the figures of the paper's workload must reach, and whether they do."""

from __future__ import annotations

import os
import statistics
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Self

#: Links, direction, readers, writers.
Cell = tuple[int, str, int, int]


@dataclass(frozen=True)
class Row:
    """One side, asked in one way, in one cell of the table; a value for each turn."""

    links: int
    direction: str
    readers: int
    writers: int
    cache_s: float
    samples: float
    pinned: bool
    side: str
    read: str
    reads_per_s: list[float]
    writes_per_s: list[float]
    links_written_per_s: list[float]
    unanswered_share: list[float | None]
    restarts_per_read: list[float]
    restarts_per_write: list[float]
    others_cores: list[float | None]
    round_trip_ns: list[float | None]
    read_ns: dict[str, list[float | None]]
    write_ns: dict[str, list[float | None]]
    delay_oldest_s: list[float | None]
    delay_mean_s: list[float | None]

    @property
    def cell(self) -> Cell:
        return self.links, self.direction, self.readers, self.writers


@dataclass(frozen=True)
class Bar:
    name: str
    limit: float
    value: float
    at_least: bool = True

    def as_dict(self) -> dict[str, Any]:
        reached = self.value >= self.limit if self.at_least else self.value <= self.limit
        sign = ">=" if self.at_least else "<="
        name = f"{self.name} {sign} {self.limit:g}"
        return {"bar": name, "value": self.value, "reached": reached}


class Table:
    def __init__(self, cells: Iterable[dict[str, Any]]) -> None:
        self.rows = [Row(**cell) for cell in cells]

    @classmethod
    def of(cls, document: dict[str, Any]) -> Self:
        return cls(document["cells"])

    def cells(self) -> list[Cell]:
        return sorted({row.cell for row in self.rows})

    def find(self, cell: Cell, side: str, read: str = "latest-common") -> Row | None:
        for row in self.rows:
            if (row.cell, row.side, row.read) == (cell, side, read):
                return row
        return None


def middle(values: Iterable[float | None]) -> float:
    """The median of what was measured; NaN where nothing was."""
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else float("nan")


def ratios(ours: list[float], other: list[float]) -> list[float]:
    """Turn by turn; a turn in which the other did nothing has none."""
    return [a / b for a, b in zip(ours, other, strict=True) if b]


def judge(table: Table) -> list[dict[str, Any]]:
    """Every bar that this table can say anything about."""
    cores = os.cpu_count() or 1
    bars = [*_against_tf2(table), *_tails(table), *_crowds(table, cores), *_against_2pl(table)]
    if cores >= 16:
        bars += _many_cores(table)
    return [bar.as_dict() for bar in bars]


def _reads(table: Table) -> list[str]:
    return sorted({row.read for row in table.rows}, reverse=True)


def _against_tf2(table: Table) -> Iterator[Bar]:
    limits = {1000: (12.0, 120.0), 1_000_000: (8.0, 80.0)}
    for cell in table.cells():
        tf2 = table.find(cell, "tf2")
        if tf2 is None or cell[0] not in limits or cell[2:] != (1, 1):
            continue
        for read in _reads(table):
            if (row := table.find(cell, "optimistic", read)) is None:
                continue
            name = f"1 reader, 1 writer, {_name(cell)}, {read}:"
            for what, limit, ours, theirs in (
                ("reads", limits[cell[0]][0], row.reads_per_s, tf2.reads_per_s),
                (
                    "link writes",
                    limits[cell[0]][1],
                    row.links_written_per_s,
                    tf2.links_written_per_s,
                ),
            ):
                yield Bar(f"{name} {what} to tf2's", limit, middle(ratios(ours, theirs)))


def _tails(table: Table) -> Iterator[Bar]:
    for cell in table.cells():
        tf2 = table.find(cell, "tf2")
        if tf2 is None or cell[2:] != (1, 1):
            continue
        for read in _reads(table):
            if row := table.find(cell, "optimistic", read):
                value = middle(row.read_ns["p999"]) / middle(tf2.read_ns["p50"])
                name = f"1 reader, 1 writer, {_name(cell)}, {read}: read p99.9 to tf2's p50"
                yield Bar(name, 1, value, at_least=False)


def _crowds(table: Table, cores: int) -> Iterator[Bar]:
    """Two threads against one, and more threads than cores against as many."""
    for links, direction, readers, writers in table.cells():
        for read in _reads(table):

            def rates(
                readers: int,
                writers: int,
                field: str,
                cell: tuple[int, str, str] = (links, direction, read),
            ) -> list[float]:
                row = table.find((*cell[:2], readers, writers), "optimistic", cell[2])
                return getattr(row, field) if row else []

            where = f"{_name((links, direction))}, {read}"
            one, two = rates(1, 0, "reads_per_s"), rates(2, 0, "reads_per_s")
            if (readers, writers) == (2, 0) and one and two:
                yield Bar(f"read-only, {where}: 2 threads to 1", 1.9, middle(ratios(two, one)))
            half = cores // 2
            if readers == writers and readers > half:
                for field, what in (("reads_per_s", "reads"), ("writes_per_s", "writes")):
                    few, many = rates(half, half, field), rates(readers, writers, field)
                    if few and many:
                        name = f"half readers, {where}: {what}, {2 * readers} threads to {cores}"
                        yield Bar(name, 0.8, middle(ratios(many, few)))


def _against_2pl(table: Table) -> Iterator[Bar]:
    for row in table.rows:
        other = table.find(row.cell, "2pl", row.read)
        if row.side != "optimistic" or other is None:
            continue
        name = f"{row.readers} readers, {row.writers} writers, {_name(row.cell)}, {row.read}:"
        pairs = [("reads", row.reads_per_s, other.reads_per_s)]
        if row.writers:
            pairs.append(("writes", row.writes_per_s, other.writes_per_s))
        for what, ours, theirs in pairs:
            yield Bar(f"{name} {what} to 2pl's", 1, middle(ratios(ours, theirs)))


def _many_cores(table: Table) -> Iterator[Bar]:
    """With 16 threads: what the report reached with 224, read-only and at half readers."""
    for links, direction, readers, writers in table.cells():
        if readers + writers != 16 or writers not in (0, 1, 8):
            continue
        for read in _reads(table):
            row = table.find((links, direction, readers, writers), "optimistic", read)
            one = table.find((links, direction, 1, 0), "optimistic", read)
            tf2 = table.find((links, direction, readers, writers), "tf2")
            where = f"{readers} readers, {writers} writers, {_name((links, direction))}, {read}"
            if writers == 0 and row and one:
                value = middle(ratios(row.reads_per_s, one.reads_per_s))
                yield Bar(f"{where}: 16 threads to 1", 14, value)
            if row and tf2:
                yield Bar(f"{where}: operations to tf2's", 143, _operations(row) / _operations(tf2))


def _operations(row: Row) -> float:
    """As the report counts: sixteen of tf2's sets are sixteen, a transaction is one."""
    writes = row.links_written_per_s if row.side == "tf2" else row.writes_per_s
    return middle(row.reads_per_s) + middle(writes)


def _name(cell: tuple[Any, ...]) -> str:
    return f"{cell[0]:,} links" + (", same direction" if cell[1] == "same" else "")
