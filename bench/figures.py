"""``make figures``: the documentation's numbers and figures from the kept results; measures
nothing. Refuses results of another commit than the code that they measure."""

from __future__ import annotations

import itertools
import json
import operator
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.machine import ROOT
from bench.results import Results, digits, rewrite_pages

PUBLISHED = json.loads((ROOT / "bench/published-2022.json").read_text())
BLUE, ORANGE, PALE = "#0072B2", "#D55E00", "#7FB8DA"
plt.rcParams |= {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
# The same picture makes the same file; text stays text, which is small and can be searched.
plt.rcParams |= {"svg.hashsalt": "zenoh-tf", "svg.fonttype": "none"}
#: Colors of many series, which the color-blind can tell apart.
COLORS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6B8E4E", "#000000")
#: What dashed lines are of.
DASHED = ("links written", "99.9 %", "mean stamp")
#: Stands for none where an axis is logarithmic.
LEAST_PERCENT = 0.01
#: A bar's group, its system, its color, its length, and the two ends of the line on it.
Bar = tuple[str, str, str, float, float, float]


def throughput(results: Results, left: Axes, right: Axes) -> None:
    _published(left, "operations_per_s", 1)
    _measured(left, results, "paper", "operations_per_s")
    _measured(right, results, "paper", "reads_per_s", "links read", 16)
    _measured(right, results, "paper", "links_written_per_s", "links written")
    _threads_axis(left, "operations/s", "As the report counts: tf2's 16 sets are 16 operations")
    _threads_axis(right, "links/s", "The same runs, links counted alike")


def latency(results: Results, left: Axes, right: Axes) -> None:
    right.sharey(left)
    right.tick_params(labelleft=False)
    _published(left, "read_latency_mean_ms", 1000)
    for axes, part in ((left, "paper"), (right, "paper-cached")):
        _measured(axes, results, part, "read_us_p50", "median")
        _measured(axes, results, part, "read_us_p999", "99.9 %")
    _threads_axis(left, "a read of 16 links, µs", "1,000,000 links; published: means")
    _threads_axis(right, "", "1,000 links")


def delay(results: Results, axes: Axes) -> None:
    _published(axes, "delay_ms", 0.001, (" (mean stamp)", " (oldest stamp)"))
    _measured(axes, results, "delay", "delay_oldest_s", "oldest stamp")
    _measured(axes, results, "delay", "delay_mean_s", "mean stamp")
    seconds = results.rows("delay")[0]["seconds"]
    _threads_axis(axes, "age of the data used, s", f"1,000,000 links, runs of {seconds} s")


def staleness(results: Results, axes: Axes) -> None:
    series = {
        ("tf2", "latest-common"): ("tf2, latest common time", ORANGE),
        ("optimistic", "latest-common"): ("zenoh-tf, latest common time", PALE),
        ("optimistic", "latest-xact"): ("zenoh-tf, latest of every link", BLUE),
    }
    bars = []
    for row in results.rows("staleness"):
        mean, tail = row["ms_mean"][1], row["ms_p99"][1]
        group = f"{row['link']}\n{row['rate_hz']:g} Hz"
        bars.append((group, *series[row["system"], row["read"]], mean, mean, tail))
    _bars(axes, bars)
    label = "age of the data used, ms: mean (number), line to the 99th percentile"
    axes.set(xlabel=label, xlim=(None, 1.08 * max(bar[5] for bar in bars)))
    _finish(axes, "How old each link of one lookup is, by kind of lookup")


def reads(results: Results, axes: Axes) -> None:
    systems = {
        "embedded": ("embedded tree", BLUE),
        "shared": ("server's memory, another process", PALE),
        "mirror": ("mirror, another host", "#2F6690"),
        "tf2": ("tf2 for Python, same process", "#6B8E4E"),
        "query": ("query of the server", ORANGE),
        "bare query": ("empty Zenoh query", "#999999"),
    }
    bars = []
    for row in results.rows("reads"):
        low, median, high = row["us_per_call"]
        bars.append((row["case"], *systems[row["system"]], median, low, high))
    _bars(axes, bars, " µs")
    axes.set(xscale="log", xlabel="time of a lookup over 4 links from Python, µs")
    axes.set_xlim(0.05, 5 * max(bar[5] for bar in bars))
    _finish(axes, "A lookup, by where it is answered")


def estimate_coverage(results: Results, axes: Axes) -> None:
    """How many truths were outside the bounds, beside how many may be."""
    rows = [row for row in results.rows("estimate", system="estimate") if "attained" in row]
    rows.sort(key=operator.itemgetter("level"))
    promised = sorted({100 * (1 - row["level"]) for row in rows})
    axes.plot(promised, promised, color="#999999", linewidth=1, label="as many as promised")
    names = dict.fromkeys(row["scenario"] for row in rows)
    for name, color, marker in zip(names, COLORS, "os^vDPX*", strict=False):
        members = [row for row in rows if row["scenario"] == name]
        outside = [max(row["outside_percent"][1], LEAST_PERCENT) for row in members]
        levels = [100 * (1 - row["level"]) for row in members]
        axes.plot(levels, outside, marker=marker, color=color, linewidth=1, label=name)
    ylabel = f"truths outside the bounds ({LEAST_PERCENT:g} %: none)"
    axes.set(xscale="log", yscale="log", xlabel="level", ylabel=ylabel)
    axes.set_xticks(promised, [f"{100 - share:.3g} %" for share in promised])
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g} %")
    axes.invert_xaxis()
    _finish(axes, "On and below the grey line the promise is kept")


def estimate_start(results: Results, axes: Axes) -> None:
    """The bound and the error of a base that has stood still, starts, and stops again."""
    axes.axvspan(0, 3, color="#eeeeee", label="it drives")
    for system, name, color in (
        ("estimate, limits", "bound with declared limits of motion", BLUE),
        ("estimate", "bound from history alone", ORANGE),
    ):
        rows = results.rows("estimate", scenario="a start and a stop", system=system)
        rows.sort(key=operator.itemgetter("seconds"))
        times = [row["seconds"] for row in rows]
        axes.plot(times, [row["bound_mm"][1] for row in rows], color=color, label=name)
    errors = [row["error_mm"][1] for row in rows]
    axes.fill_between(times, errors, color="#555555", linewidth=0, label="true error")
    axes.set(xlabel="seconds since it started, after 15 s of rest", ylabel="mm", ylim=(0, None))
    _finish(axes, "Level 0.9, samples at 20 Hz that are 80 ms late")


def _bars(axes: Axes, bars: Iterable[Bar], unit: str = "") -> None:
    """Groups of bars, with a legend of systems."""
    place, ticks, systems = 0.0, {}, set[str]()
    for group, members in itertools.groupby(bars, operator.itemgetter(0)):
        first = place
        for _, system, color, value, low, high in members:
            label = None if system in systems else system
            axes.barh(place, value, height=0.8, color=color, label=label)
            axes.hlines(place, low, high, color="#555555", linewidth=1)
            axes.text(high, place, f" {digits(value)}{unit}", va="center", fontsize=8)
            systems.add(system)
            place += 1
        ticks[group] = (first + place - 1) / 2
        place += 0.5
    axes.set_yticks([*ticks.values()], [*ticks])
    axes.invert_yaxis()


def _published(axes: Axes, metric: str, factor: float, notes: Sequence[str] = ("", "")) -> None:
    for name, note, color in zip(("proposal", "TF"), notes, (BLUE, ORANGE), strict=True):
        values = [value * factor for value in PUBLISHED[name][metric]]
        style: dict[str, Any] = {"color": color, "alpha": 0.75, "linewidth": 1.2}
        axes.plot(PUBLISHED["threads"], values, ":", label=f"{name}, published{note}", **style)


def _measured(
    axes: Axes, results: Results, part: str, metric: str, note: str = "", factor: int = 1
) -> None:
    """Medians with quartiles by threads, half of them writers: the report's workload."""
    for system, read, name, color, marker in (
        ("optimistic", "latest-xact", "zenoh-tf, optimistic", BLUE, "o"),
        ("tf2", "latest-common", "tf2", ORANGE, "s"),
    ):
        labels = {"system": system, "read": read}
        labels |= {"direction": "opposite"} if part.startswith("paper") else {}
        rows = [each for each in results.rows(part, **labels) if each["readers"] == each["writers"]]
        rows.sort(key=operator.itemgetter("readers"))
        lows, medians, highs = factor * np.array([row[metric] for row in rows]).T
        errors = [medians - lows, highs - medians]
        style: dict[str, Any] = {"color": color, "marker": marker, "linewidth": 1.8}
        if note in DASHED:
            style |= {"linestyle": "--", "markerfacecolor": "white"}
        label = f"{name}, {note}" if note else name
        threads = [2 * row["readers"] for row in rows]
        axes.errorbar(threads, medians, errors, elinewidth=1, label=label, **style)


def _threads_axis(axes: Axes, ylabel: str, title: str) -> None:
    axes.set_xscale("log", base=2)
    axes.set(yscale="log", xlabel="threads, half of them writers", ylabel=ylabel)
    axes.xaxis.set_major_formatter(matplotlib.ticker.ScalarFormatter())
    short = matplotlib.ticker.EngFormatter()
    axes.yaxis.set_major_formatter(lambda value, _: short(value) if value >= 1 else f"{value:g}")
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    _finish(axes, title)


def _finish(axes: Axes, title: str) -> None:
    """Puts the legend below the axes, where no line runs behind it."""
    axes.set_title(title, fontsize=10)
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.minorticks_off()
    axes.tick_params(length=0)
    axes.legend(fontsize=8, ncols=2, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _caption(results: Results, part: str) -> str:
    file = results.parts[part]
    about = file["machine"]
    text = f"Measured on {about['cpu']}, {about['cores']} cores, {about['compiler']},"
    text += f" {about['tf2'].split(',')[0]}; commit {file['commit'][:12]}. "
    if part in ("paper", "reads"):
        text += "Medians of the trials with their quartiles. "
    text += f"Other programs used {file['background_cores']:g} cores meanwhile."
    if part in ("paper", "delay"):
        text += f" Published: {PUBLISHED['source']}; {PUBLISHED['machine']}."
    return text


#: The figures: the part that each is of, its size in inches, its plots side by side.
FIGURES: dict[Callable[..., None], tuple[str, tuple[float, float], int]] = {
    throughput: ("paper", (10, 5), 2),
    latency: ("paper", (10, 5), 2),
    delay: ("delay", (7, 5), 1),
    staleness: ("staleness", (7.5, 4.8), 1),
    reads: ("reads", (7.5, 5), 1),
    estimate_coverage: ("estimate", (7.5, 5), 1),
    estimate_start: ("estimate", (7.5, 4.8), 1),
}


def draw(results: Results, folder: Path) -> None:
    """Writes all figures into the folder."""
    for plot, (part, size, plots) in FIGURES.items():
        figure, axes = plt.subplots(1, plots, figsize=size, squeeze=False)
        plot(results, *axes[0])
        figure.tight_layout(rect=(0, 0.07, 1, 1))
        caption = textwrap.fill(_caption(results, part), int(figure.get_figwidth() * 17))
        figure.text(0.01, 0.01, caption, fontsize=7, color="#444444")
        save(figure, folder / f"{plot.__name__}.svg")


def save(figure: Figure, path: Path) -> None:
    """Writes a figure in a fraction of the bytes: without comments, names of groups and fallback
    fonts, a tenth of a point exact."""
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(path, facecolor="white", metadata=nothing)
    svg = path.read_text()
    for pattern, text in (
        (r"<\?xml[^>]*>\s*|<!DOCTYPE[^>]*>\s*|(?s:<!--.*?-->)\s*", ""),
        (r'<g id="[^"]*"/>\s*', ""),
        (r'<g id="[^"]*">', "<g>"),
        (r' transform="rotate\(-0 [^"]*"', ""),
        (r"(?<=font-family: ).*?sans-serif", "sans-serif"),
        (r"(-?\d+\.\d)\d+(?=[^<>]*>)", r"\1"),
        (r"(?<=[;:]) (?=[^<>]*>)|(?<=\d) ?\n(?=[MLz\"])", " "),
        (r"<g>\s*</g>\s*|\n +", "\n"),
    ):
        svg = re.sub(pattern, text, svg)
    path.write_text(svg)
    plt.close(figure)
    print(path)


if __name__ == "__main__":
    kept = Results()
    kept.require_current()
    rewrite_pages(kept)
    draw(kept, ROOT / "docs/figures")
