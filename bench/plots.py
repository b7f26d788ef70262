"""The figures of the documentation, from the kept results, beside the published curves."""

from __future__ import annotations

import json
import re
import statistics
import textwrap
from pathlib import Path
from typing import Literal

import matplotlib
import numpy as np

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.machine import ROOT
from bench.results import Results

PUBLISHED = json.loads((ROOT / "bench/published-2022.json").read_text())
BLUE, ORANGE = "#0072B2", "#D55E00"


def throughput(results: Results) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5))
    _published(left, "operations_per_s", "operations_per_s", 1)
    _measured(left, results, "operations_per_s")
    _measured(right, results, "reads_per_s", "links read", factor=16)
    _measured(right, results, "links_written_per_s", "links written", dash=True)
    _threads_axis(left, "operations/s", "As the report counts: tf2's 16 sets are 16 operations")
    _threads_axis(right, "links/s", "The same runs, links counted alike")
    return figure


def latency(results: Results) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5), sharey=True)
    _published(left, "read_latency_mean_ms", "read_latency_mean_ms", 1000)
    for axes, part in ((left, "paper"), (right, "paper-cached")):
        _measured(axes, results, "read_us_p50", "median", part=part)
        _measured(axes, results, "read_us_p999", "99.9 %", part=part, dash=True)
    _threads_axis(left, "a read of 16 links, µs", "1,000,000 links; published: means")
    _threads_axis(right, "", "1,000 links")
    return figure


def delay(results: Results) -> Figure:
    figure, axes = plt.subplots(figsize=(7, 5))
    _published(axes, "delay_mean_ms", "delay_oldest_ms", 0.001, " (mean stamp)", " (oldest stamp)")
    _measured(axes, results, "delay_oldest_s", "oldest stamp", part="delay")
    _measured(axes, results, "delay_mean_s", "mean stamp", part="delay", dash=True)
    seconds = results.rows("delay")[0]["seconds"]
    _threads_axis(axes, "age of the data used, s", f"1,000,000 links, runs of {seconds} s")
    return figure


def staleness(results: Results) -> Figure:
    figure, axes = plt.subplots(figsize=(7.5, 4.8))
    rows = results.rows("staleness")
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


def reads(results: Results) -> Figure:
    figure, axes = plt.subplots(figsize=(7.5, 5))
    rows = results.rows("reads")
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
    for name, key, note, color in (
        ("proposal", ours, of_ours, BLUE),
        ("TF", tf, of_tf, ORANGE),
    ):
        values = [value * factor for value in PUBLISHED[name][key]]
        lines = axes.plot(PUBLISHED["threads"], values, ":", color=color)
        plt.setp(lines, label=f"{name}, published{note}", alpha=0.75, linewidth=1.2)


def _measured(
    axes: Axes,
    results: Results,
    metric: str,
    note: str = "",
    *,
    part: str = "paper",
    dash: bool = False,
    factor: float = 1,
) -> None:
    """Medians with quartiles by threads, half of them writers: the report's workload."""
    for label, system, read, color, marker in (
        ("zenoh-tf, optimistic", "optimistic", "latest-xact", BLUE, "o"),
        ("tf2", "tf2", "latest-common", ORANGE, "s"),
    ):
        labels = {"system": system, "read": read}
        labels |= {"direction": "opposite"} if part.startswith("paper") else {}
        rows = sorted(
            (2 * row["readers"], *(factor * value for value in row[metric]))
            for row in results.rows(part, **labels)
            if row["readers"] == row["writers"]
        )
        threads, lows, medians, highs = np.array(rows).T
        errors = (medians - lows, highs - medians)
        drawn = axes.errorbar(threads, medians, errors, color=color, elinewidth=1)
        drawn.set_label(f"{label}, {note}" if note else label)
        plt.setp(drawn[0], marker=marker, linewidth=1.8, linestyle="--" if dash else "-")
        plt.setp(drawn[0], markerfacecolor="white" if dash else color)


def _threads_axis(axes: Axes, ylabel: str, title: str) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter(matplotlib.ticker.ScalarFormatter())
    axes.yaxis.set_major_formatter(lambda value, _: _short_number(value))
    axes.set_xlabel("threads, half of them writers")
    axes.set_ylabel(ylabel)
    _finish(axes, title, "both")


def _short_number(value: float) -> str:
    for factor, unit in ((1e6, " M"), (1e3, " k")):
        if value >= factor:
            return f"{value / factor:g}{unit}"
    return f"{value:g}"


def _finish(axes: Axes, title: str, grid: Literal["x", "both"]) -> None:
    """Puts the legend below the axes, where no line runs behind it."""
    axes.set_title(title, fontsize=10)
    axes.grid(axis=grid, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.minorticks_off()
    axes.tick_params(length=0)
    axes.legend(fontsize=8, ncols=2, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _caption(results: Results, part: str, published: bool) -> str:
    file = results.parts[part]
    about = file["machine"]
    text = f"Measured on {about['cpu']}, {about['cores']} cores, {about['compiler']},"
    text += f" {about['tf2'].split(',')[0]}; commit {file['commit'][:12]}. "
    if part in ("paper", "reads"):
        text += "Medians of the trials with their quartiles. "
    text += f"Other programs used {file['background_cores']:g} cores meanwhile."
    if published:
        text += f" Published: {PUBLISHED['source']}; {PUBLISHED['machine']}."
    return text


def draw(results: Results, folder: Path) -> None:
    """Writes all figures into the folder."""
    plt.rcParams |= {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    # The same picture makes the same file; text stays text, which is small and can be searched.
    plt.rcParams |= {"svg.hashsalt": "zenoh-tf", "svg.fonttype": "none"}
    for figure_of, part, published in (
        (throughput, "paper", True),
        (latency, "paper", True),
        (delay, "delay", True),
        (staleness, "staleness", False),
        (reads, "reads", False),
    ):
        figure = figure_of(results)
        figure.tight_layout(rect=(0, 0.07, 1, 1))
        lines = textwrap.fill(_caption(results, part, published), int(figure.get_figwidth() * 17))
        figure.text(0.01, 0.01, lines, fontsize=7, color="#444444")
        path = folder / f"{figure_of.__name__}.svg"
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(path, facecolor="white", metadata=nothing)
        path.write_text(compact(path.read_text()))
        plt.close(figure)
        print(path.relative_to(ROOT))


def compact(svg: str) -> str:
    """The same picture in a fraction of the bytes: without comments, names of groups and fallback
    fonts, a tenth of a point exact."""
    svg = re.sub(r"<\?xml[^>]*>\s*|<!DOCTYPE[^>]*>\s*|<!--.*?-->\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'<g id="[^"]*"/>\s*', "", svg)
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg)
    svg = re.sub(r' transform="rotate\(-0 [^"]*"', "", svg)
    svg = re.sub(r"<[^>]*>", lambda tag: _short_numbers(tag[0]), svg)
    svg = re.sub(r'(?<=style=")[^"]*', lambda style: _short_style(style[0]), svg)
    svg = re.sub(r'(?<= d=")[^"]*', lambda path: " ".join(path[0].split()), svg)
    for _ in range(2):
        svg = re.sub(r"<g>\s*</g>\s*", "", svg)
    return re.sub(r"\n +", "\n", svg)


def _short_numbers(tag: str) -> str:
    return re.sub(r"-?\d+\.\d{2,}", lambda number: f"{float(number[0]):.1f}", tag)


def _short_style(style: str) -> str:
    style = re.sub(r"(?<=font-family: ).*sans-serif", "sans-serif", style)
    return re.sub(r"(?<=[;:]) ", "", style)
