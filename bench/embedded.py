"""The embedded tree called from Python, by turns with tf2's own Python binding."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from typing import Any

from bench.machine import ROOT
from bench.python_system import ROWS
from bench.report import Cell, Report, Target, Trial, equal_poses

#: Of each system; python3-tf2 is packaged for Debian's.
INTERPRETERS = {"zenoh-tf": sys.executable, "tf2": "/usr/bin/python3"}

COMMON, AT = "lookup(TARGET, SOURCE, latest)", "lookup(TARGET, SOURCE, next(times))"
#: Our statement, tf2's, lookups or sets of one call of ours, most microseconds each.
CASES = (
    ("tree.lookup_transform(TARGET, SOURCE)", COMMON, 1, 1.0),
    ("tree.lookup_transform(TARGET, SOURCE, next(times))", AT, 1, 1.0),
    ("tree.lookup_transforms(targets, sources, times_array)", AT, ROWS, 0.12),
    ("tree.sample(TARGET, SOURCE, times_array)", AT, ROWS, 0.12),
    ("tree.set_transform(build(), 'bench')", "store(build(), 'bench')", 1, 1.2),
    ("tree.lookup_latest_transform_xact(TARGET, SOURCE)", COMMON, 1, None),
)


def measure(report: Report) -> None:
    """Microseconds a lookup or a set."""
    systems = ["zenoh-tf"]
    if has_tf2():
        systems.append("tf2")
        if not all(map(equal_poses, run("zenoh-tf"), run("tf2"))):
            raise SystemExit("the systems' answers differ")
    else:
        print("no tf2 for Python (Debian: python3-tf2): no comparison")
    for ours, theirs, rows, limit in CASES:
        labels = {"case": ours.removeprefix("tree."), "rows": rows}
        statements = {"zenoh-tf": (ours, rows), "tf2": (theirs, 1)}
        trials = {name: functools.partial(_trial, name, *statements[name]) for name in systems}
        cells = [Cell(labels, name, run=trial) for name, trial in trials.items()]
        report.measure("embedded", cells, report.repetitions())
        if limit is not None:
            values = cells[0].values("us_per_call")
            report.check("embedded", [Target(f"{ours}, us", limit, values, at_least=False)])


def has_tf2() -> bool:
    """True if tf2's Python binding is installed."""
    try:
        run("tf2", "0")
    except (FileNotFoundError, subprocess.CalledProcessError):
        return False
    return True


def _trial(system: str, statement: str, rows: int) -> Trial:
    return {"us_per_call": run(system, statement) / rows}


def run(system: str, *statement: str) -> Any:
    """Microseconds of a statement in a process of its own, or the answers to some lookups."""
    command = [INTERPRETERS[system], "-m", "bench.python_system", system, *statement]
    return json.loads(subprocess.check_output(command, cwd=ROOT))
