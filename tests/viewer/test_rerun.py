"""``zenoh-tf rerun``: what it writes is read back by Rerun's own reader."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.processes.ports import free_port
from tests.processes.servers import ServerProcess
from tests.support.command_line import call, run, run_without, started
from tests.viewer.viewers import QUARTER, S
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._core import TransformRows
from zenoh_tf.recordings.writer import RecordingWriter

pytest.importorskip("rerun", reason="has no wheel for Python 3.10")
from rerun.chunk import RrdReader

from zenoh_tf_tools.rerun_log import _prefixes

ARM = Path(__file__).parents[2] / "examples/arm.urdf"
Row = tuple[int | None, str, list[float]]  # stamp, parent, x y z qx qy qz qw


class Log:
    """A file of Rerun."""

    def __init__(self, path: Path) -> None:
        verified = subprocess.run(
            [sys.executable, "-m", "rerun", "rrd", "verify", str(path)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert verified.returncode == 0, verified.stderr
        self.rows: dict[str, list[Row]] = {}  # of each frame
        self.shapes: dict[str, set[str]] = {}  # frame -> entities
        for chunk in RrdReader(path).stream():
            self._take(chunk)
        for rows in self.rows.values():
            rows.sort(key=lambda row: row[0] or 0)

    def _take(self, chunk: Any) -> None:
        columns = chunk.to_record_batch().to_pydict()
        if frames := columns.get("CoordinateFrame:frame"):
            for (frame,) in frames:
                self.shapes.setdefault(frame, set()).add(chunk.entity_path)
        if "Transform3D:child_frame" not in columns:
            return
        count = len(columns["Transform3D:child_frame"])
        stamps = columns.get("stamp", [None] * count)
        for i in range(count):
            pose = [
                x for c in ("translation", "quaternion") for x in columns[f"Transform3D:{c}"][i][0]
            ]
            stamp = None if stamps[i] is None else np.datetime64(stamps[i], "ns").astype(int)
            (child,) = columns["Transform3D:child_frame"][i]
            (parent,) = columns["Transform3D:parent_frame"][i]
            self.rows.setdefault(child, []).append((stamp, parent, pose))


def recorded(path: Path) -> Path:
    """Ten seconds: base_link at 1 Hz, in odom, from the middle on in map; a static camera."""
    writer = RecordingWriter(path, {})
    for i in range(11):
        row = ("odom" if i < 5 else "map", "base_link", i * S, (float(i), 0.0, 0.0, *QUARTER))
        writer.write(i * S, False, TransformRows.of_tuples([row]))
    camera = ("base_link", "a/cam \u00e4", 0, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    writer.write(0, True, TransformRows.of_tuples([camera]))
    writer.close()
    return path


def test_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = recorded(tmp_path / "run.mcap"), tmp_path / "run.rrd"
    done = call(capsys, "rerun", str(path), "--save", str(out), "--rate", "4")
    assert (done.returncode, done.stderr) == (0, "")
    log = Log(out)
    assert log.rows["a/cam \u00e4"] == [(None, "base_link", [0, 0, 1, 0, 0, 0, 1])]
    rows = log.rows["base_link"]
    # Interpolated between the samples, each instant once, by the parent of its time.
    assert [stamp for stamp, _, _ in rows] == [i * S // 4 for i in range(41)]
    assert {parent for stamp, parent, _ in rows if (stamp or 0) <= 4 * S} == {"odom"}
    assert {parent for stamp, parent, _ in rows if (stamp or 0) >= 5 * S} == {"map"}
    assert rows[9][2] == pytest.approx([2.25, 0, 0, *QUARTER], abs=1e-6)
    assert log.shapes["a/cam \u00e4"] == {"/frames/a\\/cam\\ ä"}


def test_a_live_tree_with_a_robot(
    server: ServerProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "live.rrd"
    where = ("--connect", server.endpoint)
    assert call(capsys, *where, "urdf", str(ARM), "--prefix", "r1").returncode == 0
    with server.connect() as tf:
        tf.set_transform(StampedTransform("map", "r1/base", 5 * S, Transform((1, 0, 0))))
        options = ("--save", str(out), "--urdf", str(ARM))
        with started(*where, "rerun", *options) as (process, line):
            assert line == f"showing main in {out} (Ctrl-C ends it)\n"
            size = out.stat().st_size
            tf.set_transform(StampedTransform("map", "r1/base", 6 * S, Transform((2, 0, 0))))
            tf.set_transform(StampedTransform("map", "later", 6 * S, Transform((3, 0, 0))))
            while out.stat().st_size == size:
                time.sleep(0.05)
            time.sleep(1)
            process.send_signal(signal.SIGINT)
            process.wait(60)
    log = Log(out)
    (camera,) = log.rows["r1/camera_optical"]
    assert camera[:2] == (None, "r1/camera")  # static
    assert [row[0] for row in log.rows["r1/base"]][-1] == 6 * S
    assert log.rows["later"] == [(6 * S, "map", [3, 0, 0, 0, 0, 0, 1])]
    assert any("visual" in entity for entity in log.shapes["r1/base"])


def test_the_prefixes_of_a_robot() -> None:
    links = frozenset({"base", "a/tool"})
    assert _prefixes(links, ["r1/base", "r2/a/tool", "other", "base"]) == {"r1/", "r2/", ""}


def test_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(recorded(tmp_path / "run.mcap"))
    both = call(capsys, "rerun", path, "--save", "a", "--viewer", "b")
    assert both.returncode == 2
    assert "give one of them" in both.stderr
    nowhere = call(capsys, "rerun", path, "--save", str(tmp_path / "no/a.rrd"))
    assert nowhere.returncode == 1
    assert "cannot log to Rerun" in nowhere.stderr
    robot = call(capsys, "rerun", path, "--save", str(tmp_path / "a"), "--urdf", "no.urdf")
    assert robot.stderr == "zenoh-tf: no.urdf: No such file or directory\n"
    lacking = run_without("rerun", "rerun", path)
    assert "pip install 'zenoh-tf[rerun]'" in lacking.stderr


def test_a_viewer_that_is_not_there(tmp_path: Path) -> None:
    path = str(recorded(tmp_path / "run.mcap"))
    url = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    done = run("rerun", path, "--viewer", url)
    assert done.returncode == 1
    assert "zenoh-tf: cannot log to Rerun: gRPC has been unable to connect" in done.stderr
