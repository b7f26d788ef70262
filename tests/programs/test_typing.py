"""mypy and pyright check a user's program, strictly and as for the oldest Python."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (ROOT, ROOT / "client")
PROGRAM = """
from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

import zenoh_tf
from zenoh_tf import LookupException, StampedTransform, Transform, TransformArray, TransformTree
from zenoh_tf_client import AsyncTransformClient, Broadcaster, Mirror, TransformClient

if TYPE_CHECKING:
    from typing_extensions import assert_type


def embedded() -> float:
    tree = TransformTree()
    tree.set_transform(StampedTransform("map", "base", 5, Transform(translation=(1.0, 0.0, 0.0))))
    found = tree.lookup_transform("map", "base", 5)
    assert_type(found, StampedTransform)
    assert_type(found.transform, Transform)
    assert_type(tree.lookup_transforms("map", "base", [5, 6]), TransformArray)
    assert_type(zenoh_tf.__version__, str)
    try:
        tree.lookup_transform("map", "no", 5)
    except LookupException as error:
        assert_type(error.target_frame, str | None)
    return float(np.linalg.norm(found.transform.translation))


def remote() -> None:
    with TransformClient.connect("tcp/127.0.0.1:7447", timeout_s=5.0) as tf:
        assert_type(tf, TransformClient)
        assert_type(tf.lookup_transform("map", "base", time.time_ns()), StampedTransform)
        with tf.mirror() as mirror, tf.broadcaster("wheels") as wheels:
            assert_type(mirror, Mirror)
            assert_type(wheels, Broadcaster)
            wheels.send(StampedTransform("map", "base", time.time_ns(), Transform()))


async def concurrent() -> None:
    async with await AsyncTransformClient.connect("tcp/127.0.0.1:7447") as tf:
        assert_type(tf, AsyncTransformClient)
        assert_type(await tf.lookup_transform("map", "base", 5), StampedTransform)


# Mistakes, each of which a checker must report.
Transform(translation="abc")  # WRONG
TransformTree().lookup_transform("map", 5, 5)  # WRONG
TransformTree().set_transforms  # WRONG
"""
WRONG = {number for number, line in enumerate(PROGRAM.splitlines(), 1) if line.endswith("# WRONG")}


def test_mypy(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    (tmp_path / "mypy.ini").write_text(
        f"[mypy]\nstrict = true\npython_version = 3.10\nmypy_path = {':'.join(map(str, FOLDERS))}\n"
    )
    found = subprocess.run(
        [sys.executable, "-m", "mypy", "--output=json", program.name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    reports = [json.loads(line) for line in found.stdout.splitlines()]
    assert {report["line"] for report in reports} == WRONG, found.stdout + found.stderr


def test_pyright(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    settings = {
        "extraPaths": [str(folder) for folder in FOLDERS],
        "typeCheckingMode": "strict",
        # The types of NumPy 2.5, which Python 3.12 and later have, are in the syntax of 3.12.
        "pythonVersion": "3.10" if sys.version_info < (3, 12) else "3.12",
        "reportUnusedExpression": "none",
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    found = subprocess.run(
        [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    reports = json.loads(found.stdout)["generalDiagnostics"]
    assert {report["range"]["start"]["line"] + 1 for report in reports} == WRONG, found.stdout
