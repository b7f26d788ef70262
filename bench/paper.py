"""The workload of Kawashima, "data-driven robotics", 2022: readers and writers on a snake of links.

Every side by turns with the real tf2, in one run; the driver is bench/core/paper.cpp.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from bench import native, paper_bars, paper_table
from bench.paper_bars import Table


def measure(flags: Sequence[str] = ()) -> dict[str, Any]:
    """Prints the table and what of it was to be reached; the driver's JSON and the bars."""
    turns = ("--repetitions", "9" if _cores() <= 4 else "5")  # of fewer cells: about as long
    document: dict[str, Any] = native.run("paper", *(flags or ("--threads", _threads(), *turns)))
    if not flags:
        threads = ("--threads", str(min(_cores(), 16)))
        same = native.run("paper", "--direction", "same", *threads, "--read-ratio", "0.5", *turns)
        document["cells"] += same["cells"]
    table = Table.of(document)
    paper_table.show(table)
    document["bars"] = paper_bars.judge(table)
    print()
    for bar in document["bars"]:
        verdict = "reached" if bar["reached"] else "MISSED"
        print(f"{verdict:<8} {bar['bar']:<92} {bar['value']:.3g}")
    return document


def _threads() -> str:
    """Up to the cores, and 8, which on a small machine is more than it has."""
    return ",".join(str(n) for n in (1, 2, 4, 8, 16) if n <= max(2, _cores()) or n == 8)


def _cores() -> int:
    return max(2, os.cpu_count() or 2)
