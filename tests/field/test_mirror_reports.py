"""Public reports about copies of a tree and pictures of it: mirrors, replays and the viewer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.processes.servers import ServerProcess
from tests.recordings.files import Log, write
from tests.support import command_line
from tests.viewer.conftest import tree, viewer, viser_server
from tests.viewer.viewers import Tree, step
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.viewer.viewer import Viewer

__all__ = ["tree", "viewer", "viser_server"]

S = 10**9


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as tf:
        yield tf
        tf.reset()


def stamped(parent: str, child: str, stamp_s: float, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, round(stamp_s * S), Transform((x, 0, 0)))


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("rate_hz", [None, 10.0])
def test_an_identity_is_sent_as_any_other_pose(
    tf: TransformClient, rate_hz: float | None, static: bool
) -> None:
    """RobotWebTools/tf2_web_republisher#14: a pair that never leaves the identity was never sent,
    as if it did not move; here the pair is asked for before it exists."""
    with tf.mirror([("world", "map")], max_rate_hz=rate_hz) as m:
        for second in (1, 2):
            tf.set_transform(stamped("world", "map", second), static=static)
        found = m.lookup_transform("world", "map", None if static else 2 * S, timeout_s=30.0)
        assert found.transform == Transform()


@pytest.mark.parametrize("parents", [("left", "right"), ("table", "gripper", "table")])
def test_a_mirror_follows_an_object_to_another_parent(
    tf: TransformClient, parents: tuple[str, ...]
) -> None:
    """AprilRobotics/apriltag_ros#113: the reader asks for the tag in the room, whichever camera
    sees it."""
    for x, parent in enumerate(sorted(set(parents)), 1):
        tf.set_transform(stamped("room", parent, 0, x), static=True)
    with tf.mirror([("room", "tag")]) as m:
        for second, parent in enumerate(parents, 1):
            tf.set_transform(stamped(parent, "tag", second, 10))
            m.wait_for()
            expected = sorted(set(parents)).index(parent) + 11
            assert m.lookup_transform("room", "tag").transform.translation[0] == expected
            assert m.chain("room", "tag") == ["room", parent, "tag"]


@pytest.mark.parametrize("kind", ["mcap", "bag"])
@pytest.mark.parametrize("start", ["+1s", "-0.5s"])
def test_statics_before_the_start_of_a_replay(
    tf: TransformClient,
    shared_server: ServerProcess,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    start: str,
) -> None:
    """ros2/rosbag2#1482: a bag that is played from an offset has no /tf_static any more."""
    log: Log = [
        (100.0, "/tf_static", [("base", "camera", 100.0, 0.5)]),
        *((100 + i / 10, "/tf", [("odom", "base", 100 + i / 10, float(i))]) for i in range(21)),
    ]
    path = write(tmp_path / "log", log, kind=kind)
    where = ("--connect", shared_server.endpoint)
    done = command_line.call(capsys, *where, "replay", str(path), "--start", start)
    assert done.returncode == 0, done.stderr
    assert tf.frame("camera").static
    assert tf.lookup_transform("odom", "camera").transform.translation[0] == 20.5
    first = (tf.frame("base").oldest_stamp_ns or 0) - 100 * S
    assert first == (S if start == "+1s" else S + S // 2)


@pytest.mark.parametrize("far_m", [6_378_137.0, 3_948_996.125, 5_900_018.039])
@pytest.mark.parametrize("fixed", ["earth", "base"])
def test_a_picture_far_from_the_origin(
    viewer: Viewer, tree: Tree, far_m: float, fixed: str
) -> None:
    """rerun-io/rerun#12540, ros-visualization/rviz#502: the browser computes with 32 bits, in which
    UTM and ECEF have steps of a quarter to half a metre."""
    tree.set("earth", "base", far_m)
    for number in range(5):
        tree.set("base", f"lidar_{number}", 0.01 * number, static=True)
    step(viewer)
    viewer.panel._fixed.value = fixed
    drawn = step(viewer)
    for number in range(5):
        across = drawn[f"lidar_{number}"].position - drawn["base"].position
        np.testing.assert_allclose(np.linalg.norm(across), 0.01 * number, atol=1e-4)
