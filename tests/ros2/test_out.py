"""ROS 2 out: what others commit, as nodes of rmw_zenoh and bridges receive it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest

from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.ros2 import attachment
from zenoh_tf.ros2.keys import NO_HASH, TF_MESSAGE, parse_publisher
from zenoh_tf_client import TransformClient

from .conftest import AHEAD, Peer, StartPeer, position

FLAGS = ("--ros2", "--ros2-publish")
TURNED = Transform((1, 2, 3), (0, 0, 1, 0))


@pytest.fixture
def tf(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect() as tf:
        yield tf
        tf.reset()


def rows(peer: Peer, topic: str) -> list[Any]:
    """All rows that a peer has heard on a topic."""
    return [row for key, _, rows in peer.heard() if f"{topic}/" in f"{key}/" for row in rows]


def repeat(tf: TransformClient, peer: Peer, topic: str) -> list[Any]:
    """Set a moving frame until the peer hears of it: before, nobody may listen yet."""

    def heard() -> list[Any]:
        tf.set_transform(StampedTransform("map", "drone", time.time_ns(), TURNED), "pilot")
        return rows(peer, topic)

    return list(wait_until(heard))


@pytest.mark.parametrize("humble", [False, True], ids=["newer", "humble"])
def test_nodes_hear_moving_frames(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, humble: bool
) -> None:
    peer = start_peer(server.endpoint)
    peer.listen("tf", humble)
    parent, child, stamp_ns, pose = repeat(tf, peer, "tf")[0]
    assert (parent, child, pose) == ("map", "drone", [1, 2, 3, 0, 0, 1, 0])
    assert abs(time.time_ns() - stamp_ns) < 60e9
    ((key, mark),) = {(key, mark[-32:]) for key, mark, _ in peer.heard()}
    assert key.endswith(NO_HASH if humble else TF_MESSAGE.hash)
    (publisher,) = [
        token
        for token in peer.tokens()
        if (found := parse_publisher(token)) is not None
        and found.topic.name == "tf"
        and (NO_HASH in token) == humble
    ]
    # The node is found by its mark, and numbers its messages.
    assert attachment.gid_of(publisher) == bytes.fromhex(mark)
    numbers = [attachment.decode(bytes.fromhex(mark)).number for _, mark, _ in peer.heard()]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert any("/NN/%/%/zenoh_tf" in token for token in peer.tokens())


def test_bridges_hear_moving_frames(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    peer = start_peer(server.endpoint, "client")
    peer.listen_bridge("tf")
    assert repeat(tf, peer, "tf")[0][:2] == ["map", "drone"]
    assert peer.heard()[0][1] is None


@pytest.mark.parametrize("humble", [False, True], ids=["newer", "humble"])
def test_all_statics_go_out_together_also_to_late_nodes(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, humble: bool
) -> None:
    early, late = start_peer(server.endpoint), start_peer(server.endpoint)
    early.listen("tf_static", humble)
    for number in range(3):
        link = StampedTransform("base", f"part{number}", 5, TURNED)
        tf.set_transform(link, "maker", static=True)
    wanted = {f"part{number}" for number in range(3)}
    wait_until(lambda: {row[1] for row in last_rows(early)} == wanted)
    late.listen("tf_static", humble)
    wait_until(lambda: {row[1] for row in last_rows(late)} == wanted)
    assert last_rows(late)[0][3] == [1, 2, 3, 0, 0, 1, 0]
    tf.remove_frame("part1")
    wanted -= {"part1"}
    wait_until(lambda: all({row[1] for row in last_rows(peer)} == wanted for peer in (early, late)))


def last_rows(peer: Peer) -> list[Any]:
    heard = peer.heard()
    return list(heard[-1][2]) if heard else []


def test_nothing_is_published_twice_and_nothing_of_ros_comes_back(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    robot, listener = start_peer(server.endpoint), start_peer(server.endpoint)
    for topic in ("tf", "tf_static"):
        listener.listen(topic)
    robot.node("n")
    repeat(tf, listener, "tf")
    received = tf.stats()["ros2_messages"]
    robot.send_static("n", [("body", "eye", 1, AHEAD)])
    stamp_ns = time.time_ns()
    robot.send("n", [("map", "body", stamp_ns, AHEAD)])
    assert position(tf, "map", "eye") == [2.0, 0.0, 0.0]
    tf.set_transform(StampedTransform("base", "arm", 5, TURNED), "maker", static=True)
    tf.set_transform(StampedTransform("map", "drone", stamp_ns, TURNED), "pilot")
    wait_until(lambda: any(row[:2] == ["base", "arm"] for row in rows(listener, "tf_static")))
    wait_until(lambda: any(row[2] == stamp_ns for row in by(listener, "zenoh_tf")))
    # The listener hears the robot itself; the server adds nothing of the robot's.
    assert {"body", "eye"}.isdisjoint(row[1] for row in by(listener, "zenoh_tf"))
    assert len([row for row in rows(listener, "tf") if row[1] == "body"]) == 1
    assert tf.stats()["ros2_messages"] - received == 2
    assert [each.name for each in tf.authorities() if each.name.startswith("ros2")] == [
        "ros2:0/robot"
    ]


def test_servers_on_one_network_take_each_message_once(
    server: ServerProcess, tf: TransformClient, start_server: StartServer
) -> None:
    flags = ("--ros2", "--ros2-publish", "--connect", server.endpoint)
    other = start_server(*flags, endpoint=server.endpoint, tree="other")
    with other.connect() as there:
        for child in ("warm", "camera"):
            tf.set_transform(StampedTransform("base", child, 5, TURNED), "maker", static=True)
            assert position(there, "base", child) == [1.0, 2.0, 3.0]
        there.set_transform(StampedTransform("base", "lidar", 5, TURNED), static=True)
        assert position(tf, "base", "lidar") == [1.0, 2.0, 3.0]
        for stamp in (6, 7, 8):  # sooner than a change comes back
            for where, child in ((tf, "camera"), (there, "lidar")):
                moved = StampedTransform("base", child, stamp, Transform((stamp, 0, 0)))
                where.set_transform(moved, static=True)
        wait_until(lambda: is_at(there, "camera", 8) and is_at(tf, "lidar", 8))
        for _ in range(10):
            stamp_ns = time.time_ns()
            tf.set_transform(StampedTransform("map", "drone", stamp_ns, TURNED), "pilot")
            wait_until(partial(is_at, there, "drone", stamp_ns))
        names = [each.name for each in tf.authorities()]
        assert "ros2:0/zenoh_tf" in names and not any("dds" in name for name in names)
        (heard,) = (each for each in there.authorities() if each.name)
        assert heard.name == "ros2:0/zenoh_tf" and heard.conflicts == 0
        assert 13 <= heard.stored <= 15  # of a burst, the last one at least


def is_at(tf: TransformClient, frame: str, stamp_ns: int) -> bool:
    return frame in tf.frames() and tf.frame(frame).newest_stamp_ns == stamp_ns


def test_what_comes_back_through_a_robots_server_is_not_published_again(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    """A site publishes a robot's frames; the robot's server ingests them, and so the site gets
    them once more."""
    robot = start_server("--ros2")
    flags = ("--ros2-publish", "--mirror-of", f"r={robot.endpoint}", "--connect", robot.endpoint)
    site = start_server(*flags, endpoint=robot.endpoint, tree="site")
    with robot.connect() as here, site.connect() as there:

        def echoes(least: int = 0) -> int:
            found = sum(each.stored for each in there.authorities() if ":ros2:" in each.name)
            return found if found >= least else 0

        def published() -> int:
            return int(there.stats()["ros2_published_transforms"])

        def heard() -> bool:  # before, the site may not know yet that somebody listens
            here.set_transform(StampedTransform("map", "drone", time.time_ns(), TURNED))
            return echoes() > 0

        wait_until(heard)
        for number in (1, 2, 3):
            moved = StampedTransform("map", "fixed", number, Transform((number, 0, 0)))
            here.set_transform(moved, static=True)
            wait_until(partial(is_at, here, "r/fixed", number))
        for number in range(3):
            before, echoed = published(), echoes()
            here.set_transform(StampedTransform("map", f"last{number}", 1, TURNED))
            # Published once, and an echo is here before anything else is set. It may be that of an
            # earlier one.
            wait_until(lambda b=before, e=echoed: echoes(e + 1) and published() > b)  # type: ignore[misc]
            assert published() == before + 1
        late = start_peer(robot.endpoint)
        late.listen("tf_static", False)
        wait_until(lambda: last_rows(late) == [["r/map", "r/fixed", 3, [3, 0, 0, 0, 0, 0, 1]]])


def by(peer: Peer, node: str) -> list[Any]:
    """The rows that a node has sent, by its mark."""
    marks = {
        gid.hex()
        for token in peer.tokens()
        if f"/{node}/" in token and (gid := attachment.gid_of(token)) is not None
    }
    return [row for _, mark, rows in peer.heard() if mark[-32:] in marks for row in rows]


def test_what_ros_cannot_express_keeps_nothing_back(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    peer = start_peer(server.endpoint)
    for topic in ("tf", "tf_static"):
        peer.listen(topic)
    tf.set_transform(StampedTransform("base", "late", 2**62, TURNED), "maker", static=True)
    tf.set_transform(StampedTransform("base", "good", 5, TURNED), "maker", static=True)
    wait_until(lambda: [row[1] for row in last_static(peer)] == ["good"])

    def heard() -> list[Any]:
        # One transaction, so both are in the same message.
        now_ns = time.time_ns()
        before_ns = -(2**31) * 10**9 - 1
        moved = [("early", before_ns), ("drone", now_ns)]
        tf.set_transforms_xact([StampedTransform("map", *each, TURNED) for each in moved])
        return rows(peer, "tf")

    assert {row[1] for row in wait_until(heard)} == {"drone"}
    assert tf.stats()["ros2_unpublishable"] >= 2


def test_chosen_frames_at_a_limited_rate(start_server: StartServer, start_peer: StartPeer) -> None:
    flags = ("--ros2-publish", "cam*", "--ros2-publish", "laser", "--ros2-publish-rate", "1")
    server = start_server(*flags, "--ros2-domain", "3")
    peer = start_peer(server.endpoint)
    peer.listen("tf", False, 3)
    peer.listen("tf_static", False, 3)
    with server.connect() as tf:
        for frame in ("camera", "laser", "wheel"):
            tf.set_transform(StampedTransform("base", frame, 1, TURNED), static=True)

        def move(stamp_ns: int) -> None:
            moved = [StampedTransform("map", name, stamp_ns, TURNED) for name in ("cam1", "base")]
            tf.set_transforms_xact(moved)

        def heard() -> list[Any]:
            move(1)
            return rows(peer, "tf")

        before = len(wait_until(heard))
        for stamp_ns in range(2, 102):
            move(stamp_ns)
        wait_until(lambda: rows(peer, "tf")[-1][2] == 101)
        # A message a second, for a hundred commits.
        assert len(rows(peer, "tf")) - before < 50
    assert {row[1] for row in rows(peer, "tf")} == {"cam1"}
    wait_until(lambda: {row[1] for row in last_static(peer)} == {"camera", "laser"})


def last_static(peer: Peer) -> list[Any]:
    heard = [rows for key, _, rows in peer.heard() if "tf_static" in key]
    return list(heard[-1]) if heard else []
