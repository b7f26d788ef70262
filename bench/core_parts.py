"""The other parts of the native driver: trees from life, staleness at fixed rates, memory.

What each measures, and its flags, stands in bench/core/parts.hpp.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from bench import native
from bench.paper_bars import middle, ratios
from bench.paper_table import spread


def shapes() -> Any:
    """Lookups in a humanoid and in a fleet."""
    document = native.run("shapes")
    groups: defaultdict[tuple[str, int], list[dict[str, Any]]] = defaultdict(list)
    for cell in document["cells"]:
        groups[cell["shape"], cell["threads"]].append(cell)
    for (shape, threads), cells in groups.items():
        print(f"\n{shape}, {threads} threads: lookups/s, and to tf2's")
        tf2 = next((cell["reads_per_s"] for cell in cells if cell["side"] == "tf2"), None)
        for cell in cells:
            line = f"{cell['side']:<10} {cell['read']:<13} {spread(cell['reads_per_s']):>22}"
            if tf2 and cell["side"] != "tf2":
                line += f" {spread(ratios(cell['reads_per_s'], tf2)):>18}"
            print(line)
    return document


def staleness() -> Any:
    """How old the data of a lookup is, link by link."""
    document = native.run("staleness")
    links = list(dict.fromkeys(row["link"] for row in document["rows"]))
    print("age of what is used, ms, mean/p99; publishing rates in Hz")
    rates = {row["link"]: row["rate_hz"] for row in document["rows"]}
    titles = [f"{link} ({rates[link]:g})" if rates[link] else link for link in links]
    print(f"{'side':<10} {'read':<13}", *(f"{title:>22}" for title in titles))
    for side, read in dict.fromkeys((row["side"], row["read"]) for row in document["rows"]):
        own = [row for row in document["rows"] if (row["side"], row["read"]) == (side, read)]
        cells = [f"{row['mean_s'] * 1000:.3g}/{row['p99_s'] * 1000:.3g}" for row in own]
        print(f"{side:<10} {read:<13}", *(f"{cell:>22}" for cell in cells))
    return document


def memory() -> Any:
    """Bytes for a frame with its samples."""
    document = native.run("memory")
    print(f"bytes for a frame, of {document['frames']:,}, by the samples that it holds")
    sides = list(dict.fromkeys(row["side"] for row in document["rows"]))
    print(f"{'samples':>7}", *(f"{side:>12}" for side in sides))
    for count in dict.fromkeys(row["samples"] for row in document["rows"]):
        own = [row["bytes_per_frame"] for row in document["rows"] if row["samples"] == count]
        print(f"{count:>7}", *(f"{value:>12,.0f}" for value in own))
    for side in sides:
        own_rows = [row for row in document["rows"] if row["side"] == side]
        first, last = own_rows[0], own_rows[-1]
        more = last["bytes_per_frame"] - first["bytes_per_frame"]
        print(f"{side}: {more / (last['samples'] - first['samples']):.0f} bytes for each more")
    return document


def delay() -> Any:
    """The report's own measure: a minute on a million links, which is as long as tf2 takes to set
    each of them once."""
    cells: list[dict[str, Any]] = []
    for threads in ("2", "8"):  # a run each: in a second one the data would begin old
        document = native.run(
            "paper",
            *("--links", "1000000", "--threads", threads, "--read-ratio", "0.5"),
            *("--series", "optimistic/latest-xact,tf2/latest-common"),
            *("--seconds", "60", "--repetitions", "1"),
        )
        cells += document["cells"]
    for cell in cells:
        oldest, mean = middle(cell["delay_oldest_s"]), middle(cell["delay_mean_s"])
        print(
            f"{cell['readers']} readers, {cell['writers']} writers:"
            f" {cell['side']:<10} {cell['read']:<13} oldest stamp {oldest:.3g} s,"
            f" mean stamp {mean:.3g} s"
        )
    return {"cells": cells}
