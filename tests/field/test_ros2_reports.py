"""Public reports about ROS 2 networks, replayed by emulated nodes on one server."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from tests.processes.servers import ServerProcess
from tests.ros2.conftest import AHEAD, Peer, position, server
from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient

__all__ = ["server"]

S = 10**9
FLAGS = ("--ros2", "--ros2-shared", "map", "--ros2-prefix", "namespace")


@pytest.fixture(scope="module")
def tf(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect() as tf:
        yield tf


@pytest.fixture(scope="module")
def peer(server: ServerProcess) -> Iterator[Peer]:
    peer = Peer(server.endpoint)
    yield peer
    peer.kill()


@pytest.mark.parametrize("names", [("a200_0000", "a200_0001"), ("tb1", "tb2", "fleet/tb3")])
def test_robots_that_have_only_their_namespace(
    tf: TransformClient, peer: Peer, names: tuple[str, ...]
) -> None:
    """turtlebot/turtlebot4#159, clearpathrobotics/clearpath_common#51, husarion/rosbot_xl_ros#71:
    equal frames on /NAMESPACE/tf, with one map for all."""
    stamp_ns = time.time_ns()
    for x, name in enumerate(names):
        peer.node(name, name, 0, "robot_state_publisher")
        peer.send_static(name, [("base_link", "lidar", 1, AHEAD)])
        peer.send(name, [("map", "base_link", stamp_ns, (10.0 * x, *AHEAD[1:]))])
    for x, name in enumerate(names):
        assert position(tf, "map", f"{name}/lidar") == [10.0 * x + 1, 0, 0]
    assert position(tf, f"{names[0]}/lidar", f"{names[1]}/lidar") == [10.0, 0, 0]


@pytest.mark.parametrize("joining", [13, 40])
def test_many_nodes_that_join_at_once(tf: TransformClient, peer: Peer, joining: int) -> None:
    """eclipse-zenoh/zenoh-plugin-ros2dds#690: after 13 nodes had joined together, /tf of the robot
    was silent until the bridge was started again."""
    robot = f"sr{joining}"
    peer.node(robot, robot)
    peer.send(robot, [("odom", "base", time.time_ns(), AHEAD)])
    assert position(tf, f"{robot}/odom", f"{robot}/base") == [1.0, 0.0, 0.0]
    for number in range(joining):
        peer.node(f"{robot}_{number}", robot, 0, f"rmf_{number}")
    stamp_ns = time.time_ns() + 1
    peer.send(robot, [("odom", "base", stamp_ns, (5.0, *AHEAD[1:]))])
    wait_until(lambda: tf.frame(f"{robot}/base").newest_stamp_ns == stamp_ns)
    for number in range(joining):
        peer.close_node(f"{robot}_{number}")
    peer.send(robot, [("odom", "base", stamp_ns + S, AHEAD)])
    wait_until(lambda: tf.frame(f"{robot}/base").newest_stamp_ns == stamp_ns + S)


@pytest.mark.parametrize("parts", [1, 3])
def test_statics_of_one_node_in_several_messages(
    tf: TransformClient, peer: Peer, parts: int
) -> None:
    """ros2/geometry2#183, ros/geometry2#33: a node that sends its mounts one by one."""
    robot = f"mounts{parts}"
    peer.node(robot, robot)
    rows = [("base", f"sensor_{number}", 0, AHEAD) for number in range(6)]
    for part in range(parts):
        peer.send_static(robot, rows[part::parts])
    for number in range(6):
        found = position(tf, f"{robot}/base", f"{robot}/sensor_{number}")
        assert found == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("slash", ["/", ""])
def test_names_with_a_slash_in_front(tf: TransformClient, peer: Peer, slash: str) -> None:
    """ipa320/care-o-bot#11, mit-aera/FlightGoggles#154, ros/geometry2#12: older nodes write /odom,
    newer ones odom, and one robot has both."""
    robot = f"mixed{len(slash)}"
    peer.node(robot, robot)
    peer.send(robot, [(f"{slash}odom", f"{slash}base", time.time_ns(), AHEAD)])
    peer.send_static(robot, [("base", "camera", 1, AHEAD)])
    assert position(tf, f"{robot}/odom", f"{robot}/camera") == [2.0, 0.0, 0.0]


@pytest.mark.parametrize("names", [("odom", "base_link"), ("{}/odom", "{}/base_link")])
def test_frames_that_have_their_namespace_already(
    tf: TransformClient, peer: Peer, names: tuple[str, str]
) -> None:
    """iRobotEducation/create3_sim#211: the simulator's wheels write robot1/odom on /robot1/tf, and
    its state publisher base_link."""
    robot = f"create{len(names[0])}"
    parent, child = (name.format(robot) for name in names)
    peer.node(robot, robot)
    peer.send(robot, [(parent, child, time.time_ns(), AHEAD)])
    peer.send_static(robot, [("base_link", "lidar", 1, AHEAD)])
    assert position(tf, f"{robot}/odom", f"{robot}/lidar") == [2.0, 0.0, 0.0]


@pytest.mark.parametrize("cameras", [("left", "right"), ("rgb", "stereo_0")])
def test_mounts_that_are_sent_again_as_another_tree(
    tf: TransformClient, peer: Peer, cameras: tuple[str, str]
) -> None:
    """luxonis/depthai-ros#619: nominal mounts, and 10 s later those of the calibration, with other
    parents."""
    one, two = cameras
    robot = f"oak_{one}"
    peer.node(robot, robot)
    peer.send_static(robot, [("oak", one, 1, AHEAD), ("oak", two, 1, AHEAD)])
    assert position(tf, f"{robot}/oak", f"{robot}/{one}") == [1.0, 0.0, 0.0]
    peer.send_static(robot, [("oak", two, 2, (3.0, *AHEAD[1:])), (two, one, 2, AHEAD)])
    wait_until(lambda: tf.parent(f"{robot}/{one}") == f"{robot}/{two}")
    assert position(tf, f"{robot}/oak", f"{robot}/{one}") == [4.0, 0.0, 0.0]
