"""``zenoh-tf urdf`` as a process, with a real server."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.processes.ports import free_endpoint
from tests.support import command_line
from zenoh_tf_client import TransformClient

ARM = Path(__file__).resolve().parents[2] / "examples/arm.urdf"
FLOATING = b"""<robot name="hover"><link name="world"/><link name="base"/><link name="mast"/>
<joint name="fly" type="floating"><parent link="world"/><child link="base"/></joint>
<joint name="mount" type="fixed"><parent link="base"/><child link="mast"/></joint></robot>"""

Done = subprocess.CompletedProcess[str]


def run(*args: str | Path) -> Done:
    return command_line.run("urdf", *map(str, args))


def test_fixed_joints_become_static_links(tf: TransformClient) -> None:
    done = run(ARM, "--connect", tf.endpoint, "--prefix", "r1", "--authority", "arm")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        "arm: 3 joints stored as static, root frame r1/base",
        "7 joints that move with --joint-states: "
        "pan, elbow, slide, roll, left, right, knuckle_joint",
    ]
    frame = tf.frame("r1/camera_optical")
    assert (frame.parent, frame.static, frame.authority) == ("r1/camera", True, "arm")
    for prefix, authority in (("", "urdf"), ("/r2/", "urdf/r2")):
        assert run(ARM, "--connect", tf.endpoint, "--prefix", prefix).returncode == 0
        assert tf.frame(f"{prefix.strip('/')}/camera".lstrip("/")).authority == authority
    shift = tf.lookup_transform("r1/base", "r1/shoulder").transform.translation
    assert shift.tolist() == [0.0, 0.0, 0.4]


def test_all_of_them_or_none(tf: TransformClient, tmp_path: Path) -> None:
    """The second file has one of the arm's links reversed, which closes a loop."""
    turned = tmp_path / "turned.urdf"
    turned.write_text(
        '<robot name="r"><link name="camera_optical"/><link name="camera"/><link name="x"/>'
        '<joint name="a" type="fixed"><parent link="camera"/><child link="x"/></joint>'
        '<joint name="b" type="fixed"><parent link="camera_optical"/><child link="camera"/>'
        "</joint></robot>"
    )
    run(ARM, "--connect", tf.endpoint)
    done = run(turned, "--connect", tf.endpoint)
    assert done.returncode == 1
    assert "'camera" in done.stderr
    assert "x" not in tf.frames()


def test_print_needs_no_server() -> None:
    done = run(ARM, "--print", "--connect", free_endpoint(), "--shared", "base", "--prefix", "r1")
    assert (done.returncode, done.stderr) == (0, "")
    for text in (
        "base -> r1/shoulder  fixed joint pedestal\n",
        "  translation  x   0.000000  y   0.000000  z   0.400000  m\n",
        "r1/tool -> r1/right_finger  prismatic joint right, mimics left\n",
        "arm: 3 joints fixed, root frame base\n",
    ):
        assert text in done.stdout


def test_json() -> None:
    document = json.loads(run(ARM, "--print", "--json").stdout)
    assert (document["robot"], document["root"], document["stored"]) == ("arm", "base", False)
    joints = {joint["joint"]: joint for joint in document["joints"]}
    assert joints["right"]["mimics"] == "left"
    assert joints["slide"]["axis"] == pytest.approx([0.0, 0.6, 0.8])
    assert joints["pedestal"]["translation"] == [0.0, 0.0, 0.4]


def test_floating_joints_are_named(tf: TransformClient, tmp_path: Path) -> None:
    path = tmp_path / "hover.urdf"
    path.write_bytes(FLOATING)
    done = run(path, "--connect", tf.endpoint, "--prefix", "r1", "--shared", "map,world")
    assert done.returncode == 0
    assert "left out: joint fly is floating; publish world -> r1/base yourself\n" in done.stdout
    assert sorted(tf.frames()) == ["r1/base", "r1/mast"]


def test_errors_are_one_line(tmp_path: Path) -> None:
    bad = tmp_path / "bad.urdf"
    bad.write_text("<robot>")
    for path, text in ((tmp_path / "no.urdf", "No such file"), (bad, "bad.urdf: not XML")):
        done = run(path)
        assert (done.returncode, done.stdout) == (1, "")
        assert text in done.stderr
        assert len(done.stderr.splitlines()) == 1
    error: dict[str, Any] = json.loads(run(bad, "--json").stderr)
    assert error["type"] == "InvalidArgumentException"


def test_no_server() -> None:
    done = run(ARM, "--connect", free_endpoint(), "--timeout", "0.2s")
    assert done.returncode == 1
    assert "ServerUnavailable" in done.stderr
