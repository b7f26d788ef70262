"""``python -m bench.plots RESULTS FOLDER``: the figures of the documentation.

From results that ``python -m bench core --results RESULTS``, or ``reads`` in the place of ``core``,
has written, beside the curves that were published; nothing is measured here.
"""

from __future__ import annotations

import json
import statistics
import sys
import textwrap
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.machine import ROOT

PUBLISHED = json.loads((ROOT / "bench/results/published-2022.json").read_text())
LINKS = 1_000_000
BLUE, ORANGE = "#0072B2", "#D55E00"
Cells = list[dict[str, Any]]


def throughput(cells: Cells) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5))
    _published(left, "operations_per_s", "operations_per_s", 1)
    _measured(left, cells, "operations_per_s")
    _measured(right, cells, "reads_per_s", "links read", factor=16)
    _measured(right, cells, "links_written_per_s", "links written", dash=True)
    _threads_axis(left, "operations/s", "As the report counts: tf2's 16 sets are 16 operations")
    _threads_axis(right, "links/s", "The same runs, links counted alike")
    return figure


def latency(cells: Cells) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5), sharey=True)
    _published(left, "read_latency_mean_ms", "read_latency_mean_ms", 1000)
    for axes, links in ((left, LINKS), (right, 1000)):
        _measured(axes, cells, "read_us_p50", "median", links=links)
        _measured(axes, cells, "read_us_p999", "99.9 %", links=links, dash=True)
    _threads_axis(left, "a read of 16 links, µs", "1,000,000 links; published: means")
    _threads_axis(right, "", "1,000 links")
    return figure


def delay(cells: Cells) -> Figure:
    figure, axes = plt.subplots(figsize=(7, 5))
    _published(axes, "delay_mean_ms", "delay_oldest_ms", 0.001, " (mean stamp)", " (oldest stamp)")
    _measured(axes, cells, "delay_oldest_s", "oldest stamp", part="delay")
    _measured(axes, cells, "delay_mean_s", "mean stamp", part="delay", dash=True)
    seconds = next(cell["seconds"] for cell in cells if cell["part"] == "delay")
    _threads_axis(axes, "age of the data used, s", f"1,000,000 links, runs of {seconds} s")
    return figure


def staleness(cells: Cells) -> Figure:
    figure, axes = plt.subplots(figsize=(7.5, 4.8))
    rows = [cell for cell in cells if cell["part"] == "staleness"]
    links = {row["link"]: row["rate_hz"] for row in rows}
    for offset, label, series, color in (
        (-0.26, "tf2, latest common time", ("tf2", "latest-common"), ORANGE),
        (0, "zenoh-tf, latest common time", ("optimistic", "latest-common"), "#7FB8DA"),
        (0.26, "zenoh-tf, latest of every link", ("optimistic", "latest-xact"), BLUE),
    ):
        own = [row for row in rows if (row["system"], row["read"]) == series]
        places = [list(links).index(row["link"]) + offset for row in own]
        means, tails = ([row[key][1] for row in own] for key in ("ms_mean", "ms_p99"))
        axes.barh(places, means, height=0.23, color=color, label=label)
        axes.hlines(places, means, tails, color="#555555", linewidth=1)
        for place, mean, tail in zip(places, means, tails, strict=True):
            axes.text(tail + 1, place, f"{mean:.2g}", va="center", fontsize=8)
    axes.set_yticks(range(len(links)), [f"{link}\n{rate:g} Hz" for link, rate in links.items()])
    axes.invert_yaxis()
    axes.set_xlabel("age of the data used, ms: mean (number), line to the 99th percentile")
    axes.set_xlim(right=1.08 * max(row["ms_p99"][1] for row in rows))
    _finish(axes, "How old each link of one lookup is, by how it is asked", "x")
    return figure


def reads(cells: Cells) -> Figure:
    figure, axes = plt.subplots(figsize=(7.5, 5))
    rows = [cell for cell in cells if cell["part"] == "reads"]
    ways = {
        "embedded": ("embedded tree", BLUE),
        "shared": ("server's memory, another process", "#7FB8DA"),
        "mirror": ("mirror, another host", "#2F6690"),
        "tf2": ("tf2 for Python, same process", "#6B8E4E"),
        "query": ("query of the server", ORANGE),
        "bare query": ("empty Zenoh query", "#999999"),
    }
    drawn: set[str] = set()
    for place, row in enumerate(rows):
        label, color = ways[row["system"]]
        low, median, high = row["us_per_call"]
        shown = None if label in drawn else label
        axes.barh(place, median, height=0.75, color=color, label=shown)
        axes.hlines(place, low, high, color="#555555", linewidth=1)
        axes.text(1.1 * high, place, f"{float(f'{median:.2g}'):g} µs", va="center", fontsize=8)
        drawn.add(label)
    middles = {
        row["case"]: [i for i, other in enumerate(rows) if other["case"] == row["case"]]
        for row in rows
    }
    axes.set_yticks([statistics.mean(places) for places in middles.values()], list(middles))
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(0.05, 5 * max(row["us_per_call"][2] for row in rows))
    axes.set_xlabel("time of a lookup over 4 links from Python, µs")
    _finish(axes, "A lookup by way of reading", "x")
    return figure


def _published(axes: Axes, ours: str, tf: str, factor: float, *notes: str) -> None:
    of_ours, of_tf = notes or ("", "")
    for name, key, note, color, style in (
        ("proposal", ours, of_ours, BLUE, ":^"),
        ("TF", tf, of_tf, ORANGE, ":v"),
    ):
        values = [value * factor for value in PUBLISHED[name][key]]
        lines = axes.plot(PUBLISHED["threads"], values, style, color=color, markersize=3)
        plt.setp(lines, label=f"{name}, published{note}", alpha=0.75, linewidth=1.2)


def _measured(
    axes: Axes,
    cells: Cells,
    metric: str,
    note: str = "",
    *,
    part: str = "paper",
    links: int = LINKS,
    dash: bool = False,
    factor: float = 1,
) -> None:
    """Medians with quartiles by threads, half of them writers: the report's workload."""
    for label, series, color, marker in (
        ("zenoh-tf, optimistic", ("optimistic", "latest-xact"), BLUE, "o"),
        ("tf2", ("tf2", "latest-common"), ORANGE, "s"),
    ):
        rows = sorted(
            (2 * cell["readers"], *(factor * value for value in cell[metric]))
            for cell in cells
            if cell["part"] == part and (cell["links"], cell["readers"]) == (links, cell["writers"])
            if (cell["system"], cell["read"]) == series and cell.get("direction") != "same"
        )
        threads, lows, medians, highs = np.array(rows).T
        errors = (medians - lows, highs - medians)
        drawn = axes.errorbar(threads, medians, errors, color=color, capsize=3, elinewidth=1)
        drawn.set_label(f"{label}, {note}" if note else label)
        plt.setp(drawn[0], marker=marker, linewidth=1.8, linestyle="--" if dash else "-")
        plt.setp(drawn[0], markerfacecolor="white" if dash else color)


def _threads_axis(axes: Axes, ylabel: str, title: str) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter(matplotlib.ticker.ScalarFormatter())
    axes.set_xlabel("threads, half of them writers")
    axes.set_ylabel(ylabel)
    _finish(axes, title, "both")


def _finish(axes: Axes, title: str, grid: Literal["x", "both"]) -> None:
    """Puts the legend below the axes, where no line runs behind it."""
    axes.set_title(title, fontsize=10)
    axes.grid(axis=grid, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(fontsize=8, ncols=2, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _caption(machine: dict[str, str], cells: Cells, name: str) -> list[str]:
    caption = f"Measured on {machine['cpu']}, {machine['cores']} cores, {machine['compiler']},"
    caption += f" {machine['tf2'].split(',')[0]}; commit {machine['commit']}."
    if name == "staleness":
        return [caption]
    if name == "reads":
        return [caption + " Medians of the trials, which take turns, with their quartiles."]
    if name != "delay":
        caption += " Medians of the trials with their quartiles."
    load = [cell["background_cores"][1] for cell in cells if "background_cores" in cell]
    caption += f" Other programs used {statistics.median(load):.1f} cores meanwhile."
    return [caption, f"Published: {PUBLISHED['source']}; {PUBLISHED['machine']}."]


def main() -> None:
    source, folder = map(Path, sys.argv[1:])
    results = json.loads(source.read_text())
    plt.rcParams |= {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    # The same picture makes the same file; text stays text, which is small and can be searched.
    plt.rcParams |= {"svg.hashsalt": "zenoh-tf", "svg.fonttype": "none"}
    parts = {cell["part"] for cell in results["cells"]}
    for draw in (reads,) if "reads" in parts else (throughput, latency, delay, staleness):
        figure = draw(results["cells"])
        figure.tight_layout(rect=(0, 0.07, 1, 1))
        lines = _caption(results["machine"], results["cells"], draw.__name__)
        wrapped = [textwrap.fill(line, int(figure.get_figwidth() * 17)) for line in lines]
        figure.text(0.01, 0.01, "\n".join(wrapped), fontsize=7, color="#444444")
        path = folder / f"{draw.__name__}.svg"
        figure.savefig(path, facecolor="white", metadata={"Date": None})
        print(path)


if __name__ == "__main__":
    main()
