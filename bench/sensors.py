"""Point clouds: deskewing a sweep, and transforming many points at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.report import Cell, Report, Target, Trial, ratios
from zenoh_tf import StampedTransform, Transform, TransformTree

POINTS = 100_000
#: Looked up one by one in a trial of the loop, which would take half a second otherwise.
LOOPED = 2_000
MANY = 4_000_000
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
        stamp = 10 * i * MS
        rows = [
            ("map", "odom", Transform.from_rpy(0, 0.01, 0.001 * i, (0.1 * np.sin(i / 30), 0, 0))),
            ("odom", "base", Transform.from_rpy(0.01, 0, 0.05 * i, (0.01 * i, np.sin(i / 9), 0))),
        ]
        tree.set_transforms_xact([StampedTransform(p, c, stamp, X) for p, c, X in rows])
    mount = StampedTransform("base", "lidar", 0, Transform.from_rpy(0.1, 0.2, 1, (0.1, 0.2, 1)))
    tree.set_transform(mount, static=True)
    return tree


def _deskew(report: Report, tree: TransformTree, fixed: str, labels: dict[str, Any]) -> None:
    points = np.random.default_rng(1).normal(size=(POINTS, 3)) * 20
    stamps = np.linspace(1_000 * MS, AT, labels["stamps"]).astype(np.int64)
    stamps = np.sort(np.resize(stamps, POINTS))
    some = np.linspace(0, POINTS - 1, LOOPED).astype(int)

    def loop() -> Array:
        return np.array(
            [
                tree.lookup_transform_full("lidar", AT, "lidar", stamp, fixed).transform.apply(p)
                for p, stamp in zip(points[some], stamps[some].tolist(), strict=True)
            ]
        )

    def with_numpy() -> Array:
        times, rows = np.unique(stamps, return_inverse=True)
        poses = tree.sample(fixed, "lidar", times).poses[rows]
        axis, w, u = poses[:, 3:6], poses[:, 6:], 2 * np.cross(poses[:, 3:6], points)
        moved = points + w * u + np.cross(axis, u) + poses[:, :3]
        matrix = np.linalg.inv(tree.lookup_transform(fixed, "lidar", AT).transform.matrix())
        result: Array = moved @ matrix[:3, :3].T + matrix[:3, 3]
        return result

    def ours() -> Array:
        return tree.deskew(points, stamps, "lidar", fixed, AT)

    worst = max(np.abs(ours()[some] - loop()).max(), np.abs(ours() - with_numpy()).max())
    if not worst < 1e-9:
        raise SystemExit(f"the results differ by {worst} m")
    labels = {"case": f"deskew {POINTS:,} points"} | labels
    cells = [
        Cell(labels, "deskew", run=_timed(ours, POINTS)),
        Cell(labels, "NumPy on sampled poses", run=_timed(with_numpy, POINTS)),
        Cell(labels, "loop of lookups", run=_timed(loop, LOOPED)),
    ]
    report.measure(cells, report.repetitions())
    times = [cell.values("points_per_s") for cell in cells]
    where = f"over {labels['moving links']} links at {labels['stamps']:,} stamps"
    report.check(
        Target(f"deskew {where} to {name}", limit, ratios(times[0], base))
        for name, limit, base in (("a loop of lookups", 20, times[2]), ("NumPy", 1, times[1]))
    )


def _apply(report: Report) -> None:
    transform = Transform.from_rpy(0.1, 0.2, 0.3, (1, 2, 3))
    for kind in (np.float32, np.float64):
        points: Array = np.random.default_rng(1).normal(size=(MANY, 3)).astype(kind)
        labels = {"case": f"apply to {MANY:,} points", "type": np.dtype(kind).name}
        cells = [
            Cell(labels, name, run=_timed(run, MANY))
            for name, run in _ways_to_apply(transform, points, np.zeros_like(points)).items()
        ]
        report.measure(cells, report.repetitions())


def _ways_to_apply(
    transform: Transform, points: Array, out: Array
) -> dict[str, Callable[[], object]]:
    matrix = transform.matrix().astype(points.dtype)
    return {
        "apply": lambda: transform.apply(points, out=out),
        "np.copyto": lambda: np.copyto(out, points),
        "NumPy": lambda: points @ matrix[:3, :3].T + matrix[:3, 3],
    }


def _timed(run: Callable[[], object], points: int) -> Callable[[], Trial]:
    def trial() -> Trial:
        begun_s = time.perf_counter()
        run()
        return {"points_per_s": points / (time.perf_counter() - begun_s)}

    return trial
