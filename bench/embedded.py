"""The embedded tree called from Python, by turns with tf2's own Python binding."""

from __future__ import annotations

import contextlib
import itertools
import subprocess
import timeit
from collections.abc import Callable
from typing import Any

import numpy as np

from bench import workload
from bench.processes import request, running
from bench.report import Cell, Report, Target, Trial
from bench.workload import ROWS, SET_FRAME, SOURCE, TARGET
from zenoh_tf import StampedTransform, Transform, TransformTree

#: Debian's interpreter, for which python3-tf2 is packaged.
PYTHON_WITH_TF2 = "/usr/bin/python3"

COMMON, AT = "lookup(TARGET, SOURCE, latest)", "lookup(TARGET, SOURCE, next(times))"
#: Our statement, tf2's, lookups or sets of one call of ours, most microseconds each.
CASES = (
    ("tree.lookup_transform(TARGET, SOURCE)", COMMON, 1, 1.0),
    ("tree.lookup_transform(TARGET, SOURCE, next(times))", AT, 1, 1.0),
    ("tree.lookup_transforms(targets, sources, times_array)", AT, ROWS, 0.12),
    ("tree.sample(TARGET, SOURCE, times_array)", AT, ROWS, 0.12),
    ("tree.set_transform(next(built), 'bench')", "store(next(built), 'bench')", 1, 1.2),
    ("tree.set_transform(build(), 'bench')", "store(build(), 'bench')", 1, None),
    ("tree.lookup_latest_transform(TARGET, SOURCE)", COMMON, 1, None),
    ("tree.lookup_latest_transform_xact(TARGET, SOURCE)", COMMON, 1, None),
)


def measure(report: Report) -> None:
    """Microseconds a lookup or a set."""
    tree = TransformTree(cache_time_s=workload.CACHE_S)
    for parent, child, stamp_ns, *pose in workload.history():
        tree.set_transform(StampedTransform(parent, child, stamp_ns, Transform(*pose)))
    names = _names(tree)

    def ours(statement: str, calls: int) -> float:
        names["built"] = iter([names["build"]() for _ in range(_objects(statement, calls))])
        return timeit.timeit(statement, number=calls, globals=names)

    with contextlib.ExitStack() as stack:
        try:
            peer = stack.enter_context(running("bench.tf2_peer", python=PYTHON_WITH_TF2))
        except (SystemExit, FileNotFoundError):
            print(f"{PYTHON_WITH_TF2} has no tf2_py (Debian: python3-tf2): no comparison")
            peer = None
        else:
            _check(tree, peer)

        def theirs(statement: str, calls: int) -> float:
            assert peer is not None
            built = _objects(statement, calls)
            asked = {"statement": statement, "calls": calls, "build": built}
            return float(request(peer, asked))

        for statement, other, rows, limit in CASES:
            labels = {"case": statement.removeprefix("tree."), "rows": rows}
            cells = [Cell(labels, "zenoh-tf", run=_trial(ours, statement, rows, report))]
            if peer is not None:
                cells.append(Cell(labels, "tf2", run=_trial(theirs, other, 1, report)))
            report.measure("embedded", cells, report.repetitions())
            if limit is not None:
                spent_us = cells[0].values("us_per_call")
                report.check("embedded", [Target(f"{statement}, us", limit, spent_us, False)])


def _objects(statement: str, calls: int) -> int:
    """How many transforms a statement finds ready-made."""
    return calls if "built" in statement else 0


def _names(tree: TransformTree) -> dict[str, Any]:
    """What the statements use."""
    times_ns, later_ns, pose = workload.times_ns(), workload.later_ns(), workload.pose(0, 0)
    return {
        "tree": tree,
        "TARGET": TARGET,
        "SOURCE": SOURCE,
        "targets": [TARGET] * ROWS,
        "sources": [SOURCE] * ROWS,
        "times": itertools.cycle(times_ns),
        "times_array": np.array(times_ns),
        "build": lambda: StampedTransform(TARGET, SET_FRAME, next(later_ns), Transform(*pose)),
    }


def _trial(
    timed: Callable[[str, int], float], statement: str, rows: int, report: Report
) -> Callable[[], Trial]:
    """A trial of as many calls as fill a slice of time; finding out warms up."""
    calls, slice_s = 10, report.seconds(0.1)
    while (spent_s := timed(statement, calls)) < slice_s / 4:
        calls *= 2
    calls = max(1, round(calls * slice_s / spent_s))
    return lambda: {"us_per_call": 1e6 * timed(statement, calls) / calls / rows}


def _check(tree: TransformTree, peer: subprocess.Popen[str]) -> None:
    """Ends the benchmark unless both give one answer, within 1e-9 and up to the rotation's sign."""
    for stamp_ns in (None, *workload.times_ns()[:100]):
        ours = np.array(tree.lookup_transform(TARGET, SOURCE, stamp_ns).transform.pose())
        theirs = np.array(request(peer, {"ask": stamp_ns}))
        theirs[3:] *= np.sign(ours[3:] @ theirs[3:])
        if not np.all(np.abs(ours - theirs) <= 1e-9):
            raise SystemExit(f"answers differ at {stamp_ns}: {ours}, tf2 {theirs}")
