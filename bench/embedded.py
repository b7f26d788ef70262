"""The embedded tree called from Python, by turns with tf2's own Python binding."""

from __future__ import annotations

import contextlib
import functools
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from bench.process import Process
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
#: Lookups or sets of one trial.
CALLS = 20_000


def measure(report: Report) -> None:
    """Microseconds a lookup or a set; a set includes making its transform."""
    with contextlib.ExitStack() as stack:
        systems = {"zenoh-tf": stack.enter_context(_system("zenoh-tf"))}
        if (theirs := stack.enter_context(tf2())) is not None:
            systems["tf2"] = theirs
            if not all(map(equal_poses, *(system.ask("0") for system in systems.values()))):
                raise SystemExit("the systems' answers differ")
        for ours, their_statement, rows, limit in CASES:
            statements = {"zenoh-tf": (ours, rows), "tf2": (their_statement, 1)}
            cells = [
                Cell(
                    {"case": ours.removeprefix("tree."), "rows": rows if name != "tf2" else 1},
                    name,
                    run=functools.partial(trial, report, system, *statements[name]),
                )
                for name, system in systems.items()
            ]
            report.measure(cells, report.repetitions(15))
            if limit is not None:
                values = cells[0].values("us_per_call")
                report.check([Target(f"{ours}, us", limit, values, at_least=False)])


@contextlib.contextmanager
def tf2() -> Iterator[Process | None]:
    """tf2's Python binding as a process; none, with a note, where it is not installed."""
    probe = [INTERPRETERS["tf2"], "-c", "import tf2_py, geometry_msgs.msg, genpy"]
    try:
        subprocess.run(probe, check=True, capture_output=True)
    except (FileNotFoundError, subprocess.CalledProcessError):
        print("no tf2 for Python (Debian: python3-tf2): no comparison")
        yield None
    else:
        with _system("tf2") as process:
            yield process


def _system(name: str) -> Process:
    return Process(INTERPRETERS[name], "-m", "bench.python_system", name)


def trial(report: Report, system: Process, statement: str, rows: int = 1) -> Trial:
    calls: Any = (200 if report.quick else CALLS) // rows
    return {"us_per_call": system.ask(f"{max(1, calls)} {statement}") / rows}
