"""The table of the paper's workload, for people."""

from __future__ import annotations

from bench.paper_bars import Row, Table, middle, ratios

_HEAD = (
    f"{'side':<10} {'read':<13} {'reads/s':>22} {'to tf2':>18} {'link writes/s':>22}"
    f" {'to tf2':>20} {'read us p50/p99/p99.9':>22} {'write us p50/p99/p99.9':>22}"
    f" {'delay ms oldest/mean':>20} {'no answer':>9} {'restarts a read/write':>21}"
)


def show(table: Table) -> None:
    print("medians of the turns, [lowest-highest]; ratios turn by turn")
    for cell in table.cells():
        links, direction, readers, writers = cell
        own = [row for row in table.rows if row.cell == cell]
        where = "a core each" if own[0].pinned else "more threads than cores"
        others = [cores for row in own for cores in row.others_cores if cores is not None]
        trips = [ns for row in own for ns in row.round_trip_ns if ns is not None]
        print(
            f"\n{links:,} links, {direction} direction, {readers} readers, {writers} writers"
            f" ({where}; history {own[0].cache_s:g} s, ours at most {own[0].samples:g} samples;"
            f" others used {spread(others)} cores;"
            f" a cache line between two cores and back {spread(trips)} ns)"
        )
        print(_HEAD)
        for row in own:
            print(_line(row, table.find(cell, "tf2")).rstrip())


def _line(row: Row, tf2: Row | None) -> str:
    def to_tf2(ours: list[float], other: list[float] | None) -> str:
        if other is None or row.side == "tf2" or not any(other):
            return ""
        return spread(ratios(ours, other))

    def percentiles(ns: dict[str, list[float | None]]) -> str:
        if not row.writers and ns is row.write_ns:
            return ""
        return "/".join(f"{middle(ns[key]) / 1000:,.3g}" for key in ("p50", "p99", "p999"))

    reads, writes = row.reads_per_s, row.links_written_per_s
    tf2_reads, tf2_writes = (tf2.reads_per_s, tf2.links_written_per_s) if tf2 else (None, None)
    delays = [f"{middle(delay) * 1000:,.3g}" for delay in (row.delay_oldest_s, row.delay_mean_s)]
    restarts = [f"{middle(x):.2g}" for x in (row.restarts_per_read, row.restarts_per_write)]
    return (
        f"{row.side:<10} {row.read:<13} {spread(reads):>22} {to_tf2(reads, tf2_reads):>18}"
        f" {spread(writes) if row.writers else '':>22} {to_tf2(writes, tf2_writes):>20}"
        f" {percentiles(row.read_ns):>22} {percentiles(row.write_ns):>22}"
        f" {'/'.join(delays) if row.writers else '':>20} {middle(row.unanswered_share):>9.2%}"
        f" {'' if row.side == 'tf2' else '/'.join(restarts):>21}"
    )


def spread(values: list[float]) -> str:
    """The median, [lowest-highest]."""
    if not values:
        return "unknown"
    return f"{_short(middle(values))} [{_short(min(values))}-{_short(max(values))}]"


def _short(value: float) -> str:
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if value >= size:
            return f"{value / size:.3g}{unit}"
    return f"{value:.3g}"
