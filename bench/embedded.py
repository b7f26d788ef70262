"""The embedded tree called from Python, by turns with tf2's own Python binding."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable

import numpy as np

from bench import workload
from bench.processes import request, running
from bench.report import Cell, Report, Target, Trial

#: Debian's interpreter, for which python3-tf2 is packaged.
PYTHON_WITH_TF2 = "/usr/bin/python3"

COMMON, AT = "lookup(TARGET, SOURCE, latest)", "lookup(TARGET, SOURCE, next(times))"
ROWS = workload.ROWS
#: Our statement, tf2's, lookups or sets of one call of ours, most microseconds each.
CASES = (
    ("tree.lookup_transform(TARGET, SOURCE)", COMMON, 1, 1.0),
    ("tree.lookup_transform(TARGET, SOURCE, next(times))", AT, 1, 1.0),
    ("tree.lookup_transforms(targets, sources, times_array)", AT, ROWS, 0.12),
    ("tree.sample(TARGET, SOURCE, times_array)", AT, ROWS, 0.12),
    ("tree.set_transform(next(built), 'bench')", "store(next(built), 'bench')", 1, 1.2),
    ("tree.lookup_latest_transform_xact(TARGET, SOURCE)", COMMON, 1, None),
)


def measure(report: Report) -> None:
    """Microseconds a lookup or a set."""
    with contextlib.ExitStack() as stack:
        systems: dict[str, subprocess.Popen[str]] = {}
        for name, python in (("zenoh-tf", sys.executable), ("tf2", PYTHON_WITH_TF2)):
            try:
                process = running("bench.python_system", name, python=python)
                systems[name] = stack.enter_context(process)
            except (SystemExit, FileNotFoundError):
                print(f"{python} has no {name} (Debian: python3-tf2): no comparison")
        _check(*systems.values())
        for ours, theirs, rows, limit in CASES:
            labels = {"case": ours.removeprefix("tree."), "rows": rows}
            statements = {"zenoh-tf": (ours, rows), "tf2": (theirs, 1)}
            cells = [
                Cell(labels, name, run=_trial(report, process, *statements[name]))
                for name, process in systems.items()
            ]
            report.measure("embedded", cells, report.repetitions())
            if limit is not None:
                spent_us = cells[0].values("us_per_call")
                report.check("embedded", [Target(f"{ours}, us", limit, spent_us, False)])


def _trial(
    report: Report, system: subprocess.Popen[str], statement: str, rows: int
) -> Callable[[], Trial]:
    """A trial of as many calls as fill a slice of time; finding out warms up."""

    def spent_s(calls: int) -> float:
        return float(request(system, json.dumps(["timed", statement, calls])))

    calls, slice_s = 10, report.seconds(0.1)
    while (spent := spent_s(calls)) < slice_s / 4:
        calls *= 2
    calls = max(1, round(calls * slice_s / spent))
    return lambda: {"us_per_call": 1e6 * spent_s(calls) / calls / rows}


def _check(*systems: subprocess.Popen[str]) -> None:
    """Ends the benchmark unless all give one answer, within 1e-9 and up to the rotation's sign."""
    for stamp_ns in (None, *workload.times_ns()[:100]):
        asked = json.dumps(["ask", stamp_ns])
        poses = [np.array(request(system, asked)) for system in systems]
        for pose in poses[1:]:
            pose[3:] *= np.sign(poses[0][3:] @ pose[3:])
            if not np.all(np.abs(poses[0] - pose) <= 1e-9):
                raise SystemExit(f"answers differ at {stamp_ns}: {poses}")
