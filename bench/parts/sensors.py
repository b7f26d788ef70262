"""Point clouds: deskewing a sweep, and transforming many points at once."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.report import Report, Trial
from zenoh_tf import StampedTransform, Transform, TransformTree

POINTS, MANY = 100_000, 4_000_000
#: Looked up one by one in a trial of the loop, which would take half a second otherwise.
LOOPED = 2_000
MS = 1_000_000
AT = 1_100 * MS

Array = NDArray[Any]


def measure(report: Report) -> None:
    """`deskew` beside a loop of lookups and NumPy on sampled poses; `apply` beside a copy."""
    tree = _drive()
    for fixed, links in (("odom", 1), ("map", 2)):
        for distinct in (POINTS, 1024):
            _deskew(report, tree, fixed, {"moving links": links, "stamps": distinct})
    _apply(report)


def _drive() -> TransformTree:
    """A robot that turns, at 100 Hz, on a map that is corrected as often."""
    tree = TransformTree()
    for i in range(200):
        rows = [
            ("map", "odom", Transform.from_rpy(0, 0.01, 0.001 * i, (0.1 * np.sin(i / 30), 0, 0))),
            ("odom", "base", Transform.from_rpy(0.01, 0, 0.05 * i, (0.01 * i, np.sin(i / 9), 0))),
        ]
        tree.set_transforms_xact([StampedTransform(p, c, 10 * i * MS, X) for p, c, X in rows])
    mount = StampedTransform("base", "lidar", 0, Transform.from_rpy(0.1, 0.2, 1, (0.1, 0.2, 1)))
    tree.set_transform(mount, static=True)
    return tree


def _deskew(report: Report, tree: TransformTree, fixed: str, labels: dict[str, int]) -> None:
    points = np.random.default_rng(1).normal(size=(POINTS, 3)) * 20
    stamps = np.linspace(1_000 * MS, AT, labels["stamps"]).astype(np.int64)
    stamps = np.sort(np.resize(stamps, POINTS))
    some = np.linspace(0, POINTS - 1, LOOPED).astype(int)

    def loop() -> Array:
        found = []
        for point, stamp in zip(points[some], stamps[some].tolist(), strict=True):
            X = tree.lookup_transform_full("lidar", AT, "lidar", stamp, fixed).transform
            found.append(X.apply(point))
        return np.array(found)

    def with_numpy() -> Array:
        times, rows = np.unique(stamps, return_inverse=True)
        poses = tree.sample(fixed, "lidar", times).poses[rows]
        axis, w, u = poses[:, 3:6], poses[:, 6:], 2 * np.cross(poses[:, 3:6], points)
        moved = points + w * u + np.cross(axis, u) + poses[:, :3]
        matrix = np.linalg.inv(tree.lookup_transform(fixed, "lidar", AT).transform.matrix())
        return np.asarray(moved @ matrix[:3, :3].T + matrix[:3, 3])

    def ours() -> Array:
        return tree.deskew(points, stamps, "lidar", fixed, AT)

    worst = max(np.abs(ours()[some] - loop()).max(), np.abs(ours() - with_numpy()).max())
    if not worst < 1e-9:
        raise SystemExit(f"the results differ by {worst} m")
    runs = {"deskew": _timed(ours), "NumPy": _timed(with_numpy)}
    runs["a loop of lookups"] = _timed(loop, POINTS / LOOPED)
    cells = report.compare({"case": f"deskew {POINTS:,} points"} | labels, runs)
    where = f"over {labels['moving links']} links at {labels['stamps']:,} stamps"
    for system, limit in (("a loop of lookups", 20), ("NumPy", 1)):
        values = cells[system].over(cells["deskew"], "ms")
        report.target(f"deskew {where} to {system}", values, ">=", limit)


def _apply(report: Report) -> None:
    transform = Transform.from_rpy(0.1, 0.2, 0.3, (1, 2, 3))
    for kind in ("float32", "float64"):
        points = np.random.default_rng(1).normal(size=(MANY, 3)).astype(kind)
        out, matrix = np.zeros_like(points), transform.matrix().astype(kind)
        runs = {
            "apply": _timed(functools.partial(transform.apply, points, out=out)),
            "np.copyto": _timed(functools.partial(np.copyto, out, points)),
            "NumPy": _timed(functools.partial(_with_matrix, matrix, points)),
        }
        report.compare({"case": f"apply to {MANY:,} points", "type": kind}, runs)


def _with_matrix(matrix: Array, points: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _timed(run: Callable[[], object], factor: float = 1) -> Callable[[], Trial]:
    """A trial that runs only a part of the work is multiplied."""

    def trial() -> Trial:
        begun_s = time.perf_counter()
        run()
        return {"ms": 1e3 * factor * (time.perf_counter() - begun_s)}

    return trial
