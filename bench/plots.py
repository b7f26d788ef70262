"""``python -m bench.plots RESULTS --out FOLDER``: the figures of the documentation.

From results that ``python -m bench core --results RESULTS`` has written, beside the curves that
were published; nothing is measured here.
"""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.machine import ROOT
from bench.paper_bars import Row, Table, middle

PUBLISHED = ROOT / "bench/results/published-2022.json"
LINKS = 1_000_000


@dataclass(frozen=True)
class Style:
    """A system's line: measured here, or published."""

    label: str
    color: str
    marker: str
    published: bool = False

    def line(self) -> dict[str, Any]:
        look: dict[str, Any] = {"color": self.color, "label": self.label, "marker": self.marker}
        if self.published:
            return look | {"linestyle": ":", "linewidth": 1.2, "markersize": 3, "alpha": 0.75}
        return look | {"linestyle": "-", "linewidth": 1.8, "markersize": 6}


BLUE, ORANGE = "#0072B2", "#D55E00"
OURS = Style("zenoh-tf, optimistic", BLUE, "o")
TF2 = Style("tf2", ORANGE, "s")
PROPOSAL = Style("proposal, published", BLUE, "^", published=True)
TF = Style("TF, published", ORANGE, "v", published=True)
#: Which row of the table is whose.
SIDES = ((OURS, "optimistic", "latest-xact"), (TF2, "tf2", "latest-common"))


def throughput(results: dict[str, Any], published: dict[str, Any]) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5))
    for style, name in ((PROPOSAL, "proposal"), (TF, "TF")):
        left.plot(published["threads"], published[name]["operations_per_s"], **style.line())
    table = Table.of(results["paper"])
    for style, side, read in SIDES:
        rows = _half_readers(table, side, read)
        _with_range(left, style, rows, _operations)
        _with_range(
            right, style, rows, lambda row: [16 * x for x in row.reads_per_s], label="links read"
        )
        _with_range(
            right,
            style,
            rows,
            lambda row: row.links_written_per_s,
            label="links written",
            dash=True,
        )
    _threads_axis(left, "operations/s", "As the report counts: tf2's 16 sets are 16 operations")
    _threads_axis(right, "links/s", "The same runs, links counted alike")
    return figure


def latency(results: dict[str, Any], published: dict[str, Any]) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5), sharey=True)
    for style, name in ((PROPOSAL, "proposal"), (TF, "TF")):
        means = [ms * 1000 for ms in published[name]["read_latency_mean_ms"]]
        left.plot(published["threads"], means, **style.line())
    table = Table.of(results["paper"])
    for axes, links in ((left, LINKS), (right, 1000)):
        for style, side, read in SIDES:
            rows = _half_readers(table, side, read, links)
            for key, label, dash in (("p50", "median", False), ("p999", "99.9 %", True)):
                _with_range(axes, style, rows, _read_us(key), label=label, dash=dash)
    _threads_axis(left, "a read of 16 links, µs", "1,000,000 links; published: means")
    _threads_axis(right, "", "1,000 links")
    return figure


def delay(results: dict[str, Any], published: dict[str, Any]) -> Figure:
    figure, axes = plt.subplots(figsize=(7, 5))
    axes.plot(
        published["threads"],
        [ms / 1000 for ms in published["proposal"]["delay_mean_ms"]],
        **PROPOSAL.line() | {"label": "proposal, published (mean stamp)"},
    )
    axes.plot(
        published["threads"],
        [ms / 1000 for ms in published["TF"]["delay_oldest_ms"]],
        **TF.line() | {"label": "TF, published (oldest stamp)"},
    )
    table = Table.of(results["delay"])
    for style, side, read in SIDES:
        rows = _half_readers(table, side, read)
        _with_range(axes, style, rows, lambda row: _known(row.delay_oldest_s), label="oldest stamp")
        _with_range(
            axes, style, rows, lambda row: _known(row.delay_mean_s), label="mean stamp", dash=True
        )
    _threads_axis(axes, "age of the data used, s", "1,000,000 links, runs of a minute")
    return figure


def staleness(results: dict[str, Any], _: dict[str, Any]) -> Figure:
    figure, axes = plt.subplots(figsize=(7.5, 4.8))
    rows = [row for row in results["staleness"]["rows"] if row["rate_hz"]]
    links = list(dict.fromkeys(row["link"] for row in rows))
    kinds = (
        ("tf2, latest common time", "tf2", "latest-common", ORANGE),
        ("zenoh-tf, latest common time", "optimistic", "latest-common", "#7FB8DA"),
        ("zenoh-tf, latest of every link", "optimistic", "latest-xact", BLUE),
    )
    height = 0.26
    for i, (label, side, read, color) in enumerate(kinds):
        own = [row for row in rows if (row["side"], row["read"]) == (side, read)]
        if not own:
            continue
        places = [links.index(row["link"]) + (i - 1) * height for row in own]
        means = [row["mean_s"] * 1000 for row in own]
        tails = [row["p99_s"] * 1000 - mean for row, mean in zip(own, means, strict=True)]
        axes.barh(places, means, height=height * 0.9, color=color, label=label)
        nothing = [0.0] * len(means)
        axes.errorbar(
            means, places, xerr=(nothing, tails), fmt="none", ecolor="#555555", elinewidth=1
        )
        for place, mean, tail in zip(places, means, tails, strict=True):
            axes.text(mean + tail + 1, place, f"{mean:.2g}", va="center", fontsize=8)
    rates = {row["link"]: row["rate_hz"] for row in rows}
    axes.set_yticks(range(len(links)), [f"{link}\n{rates[link]:g} Hz" for link in links])
    axes.invert_yaxis()
    axes.set_xlabel("age of the data used, ms: mean (number), line to the 99th percentile")
    axes.grid(axis="x", color="#dddddd")
    axes.set_axisbelow(True)
    _legend(axes)
    axes.set_xlim(right=max(row["p99_s"] for row in rows) * 1080)
    axes.set_title("How old each link of one lookup is, by how it is asked", fontsize=10)
    return figure


def _half_readers(table: Table, side: str, read: str, links: int = LINKS) -> list[Row]:
    """By threads, half of them writers: the report's workload."""
    found = [table.find(cell, side, read) for cell in table.cells()]
    rows = [
        row
        for row in found
        if row and row.readers == row.writers and (row.links, row.direction) == (links, "opposite")
    ]
    return sorted(rows, key=lambda row: row.readers)


def _operations(row: Row) -> list[float]:
    writes = row.links_written_per_s if row.side == "tf2" else row.writes_per_s
    return [a + b for a, b in zip(row.reads_per_s, writes, strict=True)]


def _read_us(key: str) -> Callable[[Row], list[float]]:
    return lambda row: [ns / 1000 for ns in _known(row.read_ns[key])]


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _with_range(
    axes: Axes,
    style: Style,
    rows: list[Row],
    of: Callable[[Row], list[float]],
    label: str = "",
    dash: bool = False,
) -> None:
    """The medians of the turns, with bars from the lowest to the highest."""
    known = [(row.readers + row.writers, of(row)) for row in rows if of(row)]
    if not known:
        return
    threads = [count for count, _ in known]
    medians = [middle(values) for _, values in known]
    below = [median - min(values) for median, (_, values) in zip(medians, known, strict=True)]
    above = [max(values) - median for median, (_, values) in zip(medians, known, strict=True)]
    look = style.line() | {"capsize": 3, "elinewidth": 1}
    if label:
        look["label"] = f"{style.label}, {label}"
    if dash:
        look |= {"linestyle": "--", "markerfacecolor": "white"}
    axes.errorbar(threads, medians, yerr=(below, above), **look)


def _threads_axis(axes: Axes, ylabel: str, title: str) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter(matplotlib.ticker.ScalarFormatter())
    axes.set_xlabel("threads, half of them writers")
    axes.set_ylabel(ylabel)
    axes.set_title(title, fontsize=10)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    _legend(axes)


def _legend(axes: Axes) -> None:
    """Below the axes: no line runs behind it."""
    axes.legend(fontsize=8, ncols=2, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _caption(results: dict[str, Any], published: dict[str, Any], name: str) -> str:
    machine = results["machine"]
    lines = [
        f"Measured on {machine['cpu']}, {machine['cores']} cores, {machine['compiler']},"
        f" {machine['tf2'].split(',')[0]}; commit {machine['commit']}."
    ]
    if name != "staleness":
        lines.append(f"Published: {published['source']}; {published['machine']}.")
    if name in ("throughput", "latency"):
        lines[0] += " Medians of turns, with the lowest and the highest."
    if name != "staleness":
        rows = Table.of(results["delay" if name == "delay" else "paper"]).rows
        others = max(0.0, middle(cores for row in rows for cores in row.others_cores))
        lines[0] += f" Other programs used {others:.1f} cores meanwhile."
    return "\n".join(lines)


FIGURES: dict[str, Callable[[dict[str, Any], dict[str, Any]], Figure]] = {
    "throughput": throughput,
    "latency": latency,
    "delay": delay,
    "staleness": staleness,
}


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.plots", description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--format", default="svg", choices=("svg", "png"))
    args = parser.parse_args()
    results = json.loads(args.results.read_text())
    published = json.loads(PUBLISHED.read_text())
    args.out.mkdir(parents=True, exist_ok=True)
    # The same picture makes the same file.
    plt.rcParams |= {"svg.hashsalt": "zenoh-tf", "font.size": 9, "axes.spines.top": False}
    plt.rcParams |= {"axes.spines.right": False, "savefig.facecolor": "white"}
    for name, draw in FIGURES.items():
        figure = draw(results, published)
        figure.tight_layout(rect=(0, 0.07, 1, 1))
        lines = _caption(results, published, name).splitlines()
        width = int(figure.get_figwidth() * 17)
        caption = "\n".join(textwrap.fill(line, width) for line in lines)
        figure.text(0.01, 0.01, caption, fontsize=7, color="#444444")
        path = args.out / f"{name}.{args.format}"
        figure.savefig(path, dpi=110, metadata={"Date": None} if args.format == "svg" else None)
        plt.close(figure)
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
