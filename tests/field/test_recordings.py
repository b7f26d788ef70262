"""Recordings as the field has them: docs/explanation/field.md, "Recordings"."""

from __future__ import annotations

import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.files import Log, write
from tests.recordings.pose_files import (
    ODOMETRY,
    POSE,
    POSE_COVARIANCE,
    TRANSFORM,
    Poses,
    write_poses,
)
from tests.support.command_line import call
from zenoh_tf import InvalidArgumentException, TransformTree
from zenoh_tf.recordings import RecordingError

S = 10**9

#: husarion/husarion_ugv_ros#612 and MichaelGrupp/evo#727: a robot and its ground truth.
TRUTH: Log = [
    row
    for i in range(100)
    for row in (
        (50.0 + i / 50, "/tf", [("odom", "base_link", 50.0 + i / 50, i / 100)]),
        (50.001 + i / 50, "/tf_gt", [("odom", "base_link", 50.001 + i / 50, i / 100 + 0.5)]),
    )
]
#: osrf/subt#325 and iRobotEducation/create3_docs#402: two robots with the same names.
FLEET: Log = [
    (1.0, "/r1/tf_static", [("base", "front_camera", 0.0, 1.0)]),
    (1.0, "/r2/tf_static", [("base", "rear_camera", 0.0, -1.0)]),
    *(
        row
        for i in range(50)
        for row in (
            (9.0 + i / 10, "/r1/tf", [("map", "base", 9.0 + i / 10, 1.0)]),
            (9.0 + i / 10, "/r2/tf", [("map", "base", 9.0 + i / 10 + 7e-9, 11.0)]),
        )
    ),
]


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag", "json", "unchunked"])
@pytest.mark.parametrize(
    ("log", "topics"), [(TRUTH, ("/tf", "/tf_gt")), (FLEET, ("/r1/tf", "/r2/tf"))]
)
def test_two_topics_with_one_link_are_not_mixed(
    tmp_path: Path, kind: str, log: Log, topics: tuple[str, str]
) -> None:
    """husarion/husarion_ugv_ros#612, MichaelGrupp/evo#727, osrf/subt#325."""
    path = write(tmp_path / ("log.bag" if kind == "bag" else "log"), log, kind=kind)
    with pytest.raises(RecordingError) as caught:
        TransformTree.from_recording(path)
    message = str(caught.value)
    assert f"'{topics[0]}' and '{topics[1]}'" in message
    assert f"--prefix {topics[1]}=NAME" in message and f"--topic {topics[0]}" in message
    for topic in topics:
        tree = TransformTree.from_recording(path, topics=topic.lstrip("/"))
        x = tree.sample(tree.frames()[0], tree.frames()[1], [51 * S, 10 * S]).translations
        assert not np.any(np.diff(x[~np.isnan(x[:, 0]), 0]))


def test_prefixes_keep_two_sources_apart(tmp_path: Path) -> None:
    """osrf/subt#325: the prefix of a robot's tf is that of its tf_static, too."""
    path = write(tmp_path / "log", FLEET)
    for prefixes in ({"/r2/tf": "r2"}, {"r2/tf": "r2/", "/r2/tf_static": "/r2"}):
        tree = TransformTree.from_recording(path, prefixes=prefixes)
        assert set(tree.frames()) == {
            *("map", "base", "front_camera"),
            *("r2/map", "r2/base", "r2/rear_camera"),
        }
        found = tree.lookup_transform("r2/map", "r2/rear_camera")
        assert found.transform.translation[0] == 10.0
    path = write(tmp_path / "truth", TRUTH)
    tree = TransformTree.from_recording(path, prefixes={"/tf_gt": "truth"})
    apart = [tree.lookup_transform(f"{p}odom", f"{p}base_link", 51 * S) for p in ("", "truth/")]
    x = [found.transform.translation[0] for found in apart]
    assert x[1] - x[0] == pytest.approx(0.5 - 0.0005)


def test_every_command_refuses_to_mix(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """husarion/husarion_ugv_ros#612: query, velocity, estimate, plot, replay and the viewer."""
    path = str(write(tmp_path / "log", TRUTH))
    pair = ("odom", "base_link")
    for command in (
        ("query", path, *pair, "--every", "7ms"),
        ("lookup", path, *pair),
        ("velocity", path, *reversed(pair)),
        ("estimate", path, *pair, "--at", "+1s"),
        ("explain", path, *pair),
        ("plot", path, *pair, "--out", str(tmp_path / "plot.png")),
        ("replay", path),
        ("view", path),
    ):
        done = call(capsys, *command)
        assert done.returncode == 1, command
        assert "'/tf' and '/tf_gt'" in done.stderr, command
        assert "Traceback" not in done.stderr
    found = call(capsys, "query", path, *pair, "--at", "+1s", "--topic", "tf_gt", "--json")
    assert json.loads(found.stdout)["translation"][0] == pytest.approx(1.0)
    assert "odom" in call(capsys, "query", path, "--prefix", "/tf_gt=truth").stdout
    found = call(capsys, "lookup", path, *pair, "--at", "+1s", "--topic", "/tf", "--json")
    assert json.loads(found.stdout)["translation"][0] == pytest.approx(0.5)
    # The doctor is to find such faults, so it reads both.
    assert "TF101" in call(capsys, "doctor", path).stdout
    assert "TF101" not in call(capsys, "doctor", path, "--topic", "/tf").stdout


def test_static_and_moving_topics_of_one_namespace_are_one_source(tmp_path: Path) -> None:
    """The last message decides, as on a server."""
    log: Log = [
        (1.0, "/a/tf_static", [("x", "y", 0.0, 1.0)]),
        (2.0, "/a/tf", [("x", "y", 5.0, 2.0)]),
    ]
    tree = TransformTree.from_recording(write(tmp_path / "log", log))
    assert tree.lookup_latest_transform("x", "y").transform.translation[0] == 2.0


def test_a_recorded_tree_is_explained_without_a_present(tmp_path: Path) -> None:
    """It said that the publishers had stopped, and to check that they run."""
    log: Log = [
        (at, "/tf", [("map", child, at, 0.0) for child in children])
        for at, children in ((1.0, "ab"), (1.1, "ab"), (1.2, "ab"), (31.0, "b"), (31.1, "b"))
    ]
    tree = TransformTree.from_recording(write(tmp_path / "log", log))
    found = tree.explain("b", "a", 5_000_000_000)
    assert found.advice == (
        "The recording has data of all links of the chain from 1.000000000 s to 1.200000000 s.",
    )


@pytest.mark.parametrize("other", ["/b/tf_static", "/tf"])
def test_the_doctor_sees_what_breaks_a_row_of_repeated_statics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], other: str
) -> None:
    """200,000 messages of the same statics took the doctor 26 s; it skips repetitions now."""
    same = [("base", "camera", 0.0, 1.0), ("base", "lidar", 0.0, 2.0)]
    log = [(1.0 + i / 100, "/tf_static", same) for i in range(300)]
    path = str(write(tmp_path / "same", log))
    assert call(capsys, "doctor", path).returncode == 0
    moved = (2.505, other, [("base", "lidar", 2.0, 2.5)])
    found = call(capsys, "doctor", str(write(tmp_path / "moved", [*log[:150], moved, *log[150:]])))
    assert found.returncode == 3
    assert "lidar" in found.stdout and "camera" not in found.stdout


POSES: Poses = [
    *(
        (1.0 + i / 100, "/body/pose", TRANSFORM, "world", "body", 4.0 + i / 100, i)
        for i in range(9)
    ),
    *((2.0 + i / 100, "/odom", ODOMETRY, "odom", "base_link", 5.0 + i, 2.0 * i) for i in range(9)),
    *((3.0 + i / 100, "/goal", POSE, "map", "", 6.0 + i, 3.0 * i) for i in range(9)),
    *((4.0 + i / 100, "/amcl", POSE_COVARIANCE, "map", "", 7.0 + i, 4.0 * i) for i in range(9)),
]


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_topics_with_poses_are_read_by_request(tmp_path: Path, kind: str) -> None:
    """MichaelGrupp/evo#221 and #131."""
    path = write_poses(tmp_path / ("log.bag" if kind == "bag" else "log"), POSES, kind=kind)
    with pytest.raises(RecordingError) as caught:
        TransformTree.from_recording(path)
    for topic in ("/amcl", "/body/pose", "/goal", "/odom"):
        assert f"'{topic}'" in str(caught.value)
    assert "--topic /amcl" in str(caught.value)
    tree = TransformTree.from_recording(path, topics=["/body/pose", "odom", "/goal", "amcl"])
    for target, source, stamp_s, x in (
        ("world", "body", 4.04, 4.0),
        ("odom", "base_link", 9.0, 8.0),
        ("map", "goal", 9.0, 9.0),
        ("map", "amcl", 9.0, 8.0),
    ):
        found = tree.lookup_transform(target, source, round(stamp_s * S))
        assert found.transform.translation[0] == pytest.approx(x)
    assert TransformTree.from_recording(path, topics="odom").frames() == ["base_link", "odom"]


def test_topics_that_are_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path / "log", TRUTH)
    with caplog.at_level(logging.WARNING, "zenoh_tf.recordings"):
        TransformTree.from_recording(path, topics=["/tf", "/odmo"], prefixes={"/gt": "x"})
    assert "no such topic with transforms or poses: '/gt', '/odmo'" in caplog.text
    with pytest.raises(InvalidArgumentException, match="topics has ''"):
        TransformTree.from_recording(path, topics="")
    assert "TOPIC=NAME" in call(capsys, "query", str(path), "--prefix", "tf").stderr
    done = call(capsys, "velocity", "base_link", "odom", "--topic", "/tf")
    assert re.search(r"give its\s+FILE", done.stderr)
