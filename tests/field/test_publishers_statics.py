"""Publishers of static transforms of the field, which come, go and disagree."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.ros2.conftest import Peer, authorities, position
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

StartPeer = Callable[..., Peer]
GRACE_S = 0.5


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    log = tmp_path_factory.mktemp("ros2") / "server.log"
    flags = ("--ros2", "--ros2-static-grace", f"{GRACE_S}s")
    server = ServerProcess(log, free_endpoint(), "main", flags)
    yield server
    server.stop()


@pytest.fixture
def tf(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect() as tf:
        yield tf


@pytest.fixture
def start_peer() -> Iterator[StartPeer]:
    running: list[Peer] = []

    def start(endpoint: str, mode: str = "peer") -> Peer:
        running.append(Peer(endpoint, mode))
        return running[-1]

    yield start
    for peer in running:
        peer.kill()


def ahead(x: float) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def is_at(tf: TransformClient, parent: str, child: str, x: float) -> bool:
    return child in tf.frames() and position(tf, parent, child) == [x, 0.0, 0.0]


# --- RobotecAI/o3de-ros2-gem#278, o3de/o3de-extras#140


@pytest.mark.parametrize(
    ("humble", "stamp_ns"), [(False, 1_700_000_000_000_000_000), (True, 0)], ids=["newer", "humble"]
)
def test_statics_of_the_scene_before_go(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, humble: bool, stamp_ns: int
) -> None:
    """A simulator undeclares its publisher and makes another one, in one session and one node."""
    name = f"sim{humble}{bool(stamp_ns)}"
    peer = start_peer(server.endpoint)
    peer.node("n", name, 0, "editor", humble)
    old = [(f"{name}/ns1/base", f"{name}/ns1/{link}", stamp_ns, ahead(1.0)) for link in "ab"]
    peer.send_static("n", old)
    wait_until(lambda: f"{name}/ns1/b" in tf.frames())
    peer.renew("n", 12)
    new = (f"{name}/ns2/base", f"{name}/ns2/lidar", stamp_ns, ahead(2.0))
    peer.send_static("n", [new])
    wait_until(lambda: is_at(tf, f"{name}/ns2/base", f"{name}/ns2/lidar", 2.0))
    wait_until(lambda: not {f"{name}/ns1/a", f"{name}/ns1/b"} & set(tf.frames()))
    assert is_at(tf, f"{name}/ns2/base", f"{name}/ns2/lidar", 2.0)


def test_statics_that_the_next_publisher_repeats_stay(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    """What both have sent is the new one's; what it corrects is its value."""
    peer = start_peer(server.endpoint)
    peer.node("n", "repeat")
    rows = [("r_base", "r_same", 1, ahead(1.0)), ("r_base", "r_moved", 1, ahead(2.0))]
    peer.send_static("n", [*rows, ("r_base", "r_gone", 1, ahead(3.0))])
    wait_until(lambda: "r_gone" in tf.frames())
    peer.renew("n", 12)
    peer.send_static("n", [rows[0], ("r_base", "r_moved", 1, ahead(5.0))])
    wait_until(lambda: "r_gone" not in tf.frames())
    assert is_at(tf, "r_base", "r_same", 1.0) and is_at(tf, "r_base", "r_moved", 5.0)


def test_a_publisher_that_is_silent_but_alive_keeps_its_statics(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    """Both stay. A third publisher of the node that ends shows that the grace has passed."""
    peer = start_peer(server.endpoint)
    peer.node("n", "both")
    peer.send_static("n", [("k1_base", "k1_lidar", 1, ahead(1.0))])
    peer.renew("n", 12, True)
    peer.send_static("n", [("k2_base", "k2_lidar", 1, ahead(1.0))])
    wait_until(lambda: "k2_lidar" in tf.frames())
    peer.renew("n", 13, False)
    wait_until(lambda: "k2_lidar" not in tf.frames())
    assert is_at(tf, "k1_base", "k1_lidar", 1.0)


# --- IFL-CAMP/easy_handeye#46, moveit/moveit_calibration#115


def stray_on_tf(peer: Peer, tf: TransformClient, parent: str, child: str) -> None:
    peer.node("stray", "left_over", 0, child)
    peer.send("stray", [(parent, child, time.time_ns(), ahead(9.0))])


def stray_static(peer: Peer, tf: TransformClient, parent: str, child: str) -> None:
    peer.node("stray", "left_over", 0, child)
    peer.send_static("stray", [(parent, child, 5, ahead(9.0))])


def stray_sensor(peer: Peer, tf: TransformClient, parent: str, child: str) -> None:
    stamped = StampedTransform(parent, child, time.time_ns(), Transform((9.0, 0.0, 0.0)))
    with tf.broadcaster("left_over") as broadcaster:
        broadcaster.send([stamped])
        wait_until(lambda: is_at(tf, parent, child, 9.0))


STRAYS = {
    "on /tf": stray_on_tf,
    "static": stray_static,
    "a sensor without ROS": stray_sensor,
    "another parent": lambda peer, tf, parent, child: stray_on_tf(peer, tf, f"{parent}_2", child),
}


@pytest.mark.parametrize("name", STRAYS)
def test_a_calibration_that_is_announced_again_is_taken_again(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, name: str
) -> None:
    """IFL-CAMP/easy_handeye#46: also after the stray publisher has ended."""
    frame = f"camera_{[*STRAYS].index(name)}"
    calibration, other = start_peer(server.endpoint), start_peer(server.endpoint)
    calibration.node("n", "calibration", 0, f"{frame}_node")
    row = (f"{frame}_ee", frame, 7, ahead(0.03))
    calibration.send_static("n", [row])
    wait_until(lambda: is_at(tf, f"{frame}_ee", frame, 0.03))
    authority = tf.frame(frame).authority
    STRAYS[name](other, tf, f"{frame}_ee", frame)
    wait_until(lambda: tf.frame(frame).authority != authority)
    other.kill()
    calibration.send_static("n", [row])
    wait_until(lambda: tf.frame(frame).authority == authority)
    assert is_at(tf, f"{frame}_ee", frame, 0.03) and tf.frame(frame).static


def test_a_correction_by_a_call_is_no_stray(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    """The announcer of the old value does not know of it."""
    peer = start_peer(server.endpoint)
    peer.node("n", "corrected")
    row = ("c_ee", "c_camera", 7, ahead(0.03))
    peer.send_static("n", [row])
    wait_until(lambda: is_at(tf, "c_ee", "c_camera", 0.03))
    corrected = StampedTransform("c_ee", "c_camera", 8, Transform((0.5, 0.0, 0.0)))
    tf.set_transform(corrected, authority="operator", static=True)
    peer.send_static("n", [row, ("c_ee", "c_other", 7, ahead(1.0))])
    wait_until(lambda: "c_other" in tf.frames())
    assert is_at(tf, "c_ee", "c_camera", 0.5)


# --- two writers of one static link, before and after a restart


@pytest.mark.parametrize(("sessions", "order"), [(1, (1.0, 2.0)), (2, (2.0, 1.0))])
def test_two_writers_of_a_static_are_resolved_alike_after_a_restart(
    start_server: StartServer, start_peer: StartPeer, sessions: int, order: tuple[float, float]
) -> None:
    """RobotecAI/o3de-ros2-gem#278 with two nodes of one process, or of two: the newest announcement
    counts. Its stamp is older here, and its node comes first by name."""
    endpoint = free_endpoint()
    start_peer(endpoint, "router")
    peers = [start_peer(endpoint) for _ in range(sessions)]
    for number, x in enumerate(order):
        peer = peers[number % sessions]
        peer.node(f"n{number}", "", 0, f"node{9 - number}")
        if number and sessions == 1:
            peer.renew(f"n{number}", 12)  # the emulated nodes of one session number alike
        peer.send_static(f"n{number}", [("base", "arm", 100 - number, ahead(x))])
    found = []
    for _ in range(2):
        flags = ("--ros2", "--connect", endpoint)
        server = start_server(*flags, endpoint=endpoint)
        with server.connect() as tf:
            names = {"ros2:0/node8", "ros2:0/node9"}
            wait_until(lambda tf=tf: tf.stats()["ros2_messages"] >= 2)  # type: ignore[misc]
            wait_until(lambda tf=tf: is_at(tf, "base", "arm", order[1]))  # type: ignore[misc]
            found.append((tf.frame("arm").authority, names & set(authorities(tf))))
        server.stop()
    assert {authority for authority, _ in found} == {"ros2:0/node8"}


# --- servers that publish on ROS 2 and replace each other


@pytest.mark.parametrize("corrects", [False, True], ids=["the same", "corrected"])
def test_statics_of_a_robot_whose_server_is_replaced_stay(
    server: ServerProcess,
    tf: TransformClient,
    start_server: StartServer,
    corrects: bool,
) -> None:
    """Its ROS 2 side is a publisher with another id in another session."""
    prefix = f"bridge{corrects}"
    flags = ("--ros2-publish", "--connect", server.endpoint, "--tree", prefix)

    def serve(x: float) -> ServerProcess:
        robot = start_server(*flags, endpoint=server.endpoint, tree=prefix)
        with robot.connect() as robot_tf:
            arm = StampedTransform(f"{prefix}_base", f"{prefix}_arm", 1, Transform((x, 0, 0)))
            robot_tf.set_transform(arm, authority="driver", static=True)
        return robot

    first = serve(1.0)
    wait_until(lambda: is_at(tf, f"{prefix}_base", f"{prefix}_arm", 1.0))
    first.kill()
    dropped = tf.stats()["ros2_statics_dropped"]
    second = serve(2.0 if corrects else 1.0)
    wait_until(lambda: is_at(tf, f"{prefix}_base", f"{prefix}_arm", 2.0 if corrects else 1.0))
    assert tf.stats()["ros2_statics_dropped"] - dropped <= 1
    second.stop()
