"""ROS 2 in: emulated nodes and bridges, and a server that has nothing but --ros2."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.processes.servers import ServerProcess
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf._core import TransformRows
from zenoh_tf.ros2.cdr import JointState, encode_joint_state, encode_tf_message
from zenoh_tf.ros2.keys import NO_HASH, TF_MESSAGE
from zenoh_tf_client import TransformClient

from .conftest import (
    AHEAD,
    Peer,
    StartPeer,
    authorities,
    position,
    wait_for_authority,
)

KEY = f"0/%s/{TF_MESSAGE.chunk}/{TF_MESSAGE.hash}"
FLAGS = ("--ros2", "--ros2-static-grace", "0.5s")


@pytest.fixture
def tf(server: ServerProcess) -> Iterator[TransformClient]:
    with server.connect() as tf:
        yield tf


@pytest.fixture
def peer(server: ServerProcess, start_peer: StartPeer) -> Peer:
    return start_peer(server.endpoint)


@pytest.mark.parametrize("humble", [False, True], ids=["newer", "humble"])
@pytest.mark.parametrize("mode", ["peer", "client"])
def test_a_node(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, mode: str, humble: bool
) -> None:
    name = f"{mode}{humble}"
    peer = start_peer(server.endpoint, mode)
    peer.node("n", name, 3, "nav", humble)
    peer.send_static("n", [(f"{name}/base", f"/{name}/laser", 1, AHEAD)])
    peer.send("n", [(f"{name}/odom", f"{name}/base", time.time_ns(), AHEAD)])
    assert position(tf, f"{name}/odom", f"{name}/laser") == [2.0, 0.0, 0.0]
    assert authorities(tf)[f"ros2:3/{name}/nav"].stored == 2
    assert tf.frame(f"{name}/laser").static


def test_equal_nodes_of_two_sessions_have_two_names(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    peers = [start_peer(server.endpoint) for _ in range(2)]
    zids = [peer.node("n", "twin", 0, "nav") for peer in peers]
    wait_until(lambda: tf.stats()["ros2_publishers"] >= 4)
    for number, peer in enumerate(peers):
        peer.send("n", [("twin_odom", "twin_base", time.time_ns() + number, AHEAD)])
        name = f"ros2:0/twin/nav@{zids[number][:8]}"
        wait_for_authority(tf, name)
    # A frame with two publishers is seen.
    assert authorities(tf)[f"ros2:0/twin/nav@{zids[1][:8]}"].conflicts == 1
    assert tf.frame("twin_base").authority_changes == 1


def test_messages_without_a_token_are_named_by_their_topic(tf: TransformClient, peer: Peer) -> None:
    payload = peer_message("orphan", "orphan_base")
    old = b"\x0fsequence_number" + struct.pack("<q", 1) + b"\x10source_timestamp"
    old += struct.pack("<q", 2) + b"\x0asource_gid" + b"\x10" + bytes(range(16))
    for number, (attachment, authority) in enumerate(
        [
            (None, "ros2:0/orphan/tf"),
            ((struct.pack("<qqB", 1, 2, 16) + b"\xab" * 16).hex(), "ros2:0/orphan/tf#abababab"),
            (old.hex(), "ros2:0/orphan/tf#00010203"),
        ]
    ):
        bad = tf.stats()["ros2_bad_attachments"]
        peer.put(KEY % "orphan/tf", payload, attachment)
        wait_for_authority(tf, authority)
        assert tf.stats()["ros2_bad_attachments"] == bad, number


def peer_message(parent: str, child: str) -> str:
    """A message of one transform, in hexadecimal."""
    row = StampedTransform(parent, child, time.time_ns(), Transform(AHEAD[:3], AHEAD[3:]))
    return encode_tf_message(TransformRows.of([row])).hex()


@pytest.mark.parametrize("history", ["cache", "queryable"])
def test_a_bridge(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer, history: str
) -> None:
    name = f"bot_{history}"
    peer = start_peer(server.endpoint, "bridge")
    peer.bridge("b", name, history)
    # Two nodes behind it: the bridge keeps a message of each.
    peer.send_static("b", [(f"{name}_base", f"{name}_laser", 1, AHEAD)])
    peer.send_static("b", [(f"{name}_base", f"{name}_camera", 1, AHEAD)])
    peer.send("b", [(f"{name}_odom", f"{name}_base", time.time_ns(), AHEAD)])
    for frame in ("laser", "camera"):
        assert position(tf, f"{name}_odom", f"{name}_{frame}") == [2.0, 0.0, 0.0]
    assert f"ros2dds:/{name}" in authorities(tf)


def test_statics_that_are_sent_again_are_not_stored_again(tf: TransformClient, peer: Peer) -> None:
    peer.node("n", "again")
    rows = [("again_base", f"again_{number}", 1, AHEAD) for number in range(3)]
    for _ in range(3):
        peer.send_static("n", rows)
    peer.send_static("n", [*rows[1:], ("again_base", "again_3", 1, AHEAD)])  # a delta is merged
    wait_until(lambda: "again_3" in tf.frames())
    assert authorities(tf)["ros2:0/again/robot"].stored == 4
    changed = ("again_base", "again_0", 2, (5.0, *AHEAD[1:]))
    peer.send_static("n", [changed])
    wait_until(lambda: position(tf, "again_base", "again_0") == [5.0, 0.0, 0.0])


def test_statics_of_a_node_that_is_made_again(tf: TransformClient, peer: Peer) -> None:
    """It has another id, and counts from 1 again."""
    peer.node("n", "renewed", 0, "first")
    for x in (1.0, 2.0, 3.0):
        peer.send_static("n", [("renewed_base", "renewed_arm", 1, (x, *AHEAD[1:]))])
    wait_until(lambda: "renewed_arm" in tf.frames())
    wait_until(lambda: position(tf, "renewed_base", "renewed_arm") == [3.0, 0.0, 0.0])
    peer.node("n", "renewed", 0, "second")
    peer.send_static("n", [("renewed_base", "renewed_arm", 1, (9.0, *AHEAD[1:]))])
    wait_until(lambda: position(tf, "renewed_base", "renewed_arm") == [9.0, 0.0, 0.0])


def test_statics_that_are_sent_again_after_a_reset_come_back(
    tf: TransformClient, peer: Peer
) -> None:
    peer.node("n", "back")
    row = ("back_base", "back_arm", 1, AHEAD)
    peer.send_static("n", [row])
    wait_until(lambda: "back_arm" in tf.frames())
    tf.reset()
    peer.send_static("n", [row])
    assert position(tf, "back_base", "back_arm") == [1.0, 0.0, 0.0]


def test_statics_that_were_refused_are_tried_again(tf: TransformClient, peer: Peer) -> None:
    peer.node("n", "loop")
    tf.set_transform(StampedTransform("loop_a", "loop_b", 1, Transform()), static=True)
    refused = tf.stats()["bad_puts"]
    row = ("loop_b", "loop_a", 1, AHEAD)
    peer.send_static("n", [row])
    wait_until(lambda: tf.stats()["bad_puts"] > refused)
    tf.remove_frame("loop_b")
    peer.send_static("n", [row])
    assert position(tf, "loop_b", "loop_a") == [1.0, 0.0, 0.0]


def test_of_two_publishers_of_a_static_the_one_that_sent_last_counts(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    peers = [start_peer(server.endpoint) for _ in range(2)]
    for number, peer in enumerate(peers):
        peer.node("n", "last", 0, f"node{number}")
    for number in (0, 1, 0):
        x = 1.0 + number
        peers[number].send_static("n", [("last_base", "last_arm", 1, (x, *AHEAD[1:]))])
        wait_until(lambda: "last_arm" in tf.frames())
        wait_until(lambda x=x: position(tf, "last_base", "last_arm")[0] == x)  # type: ignore[misc]


def test_statics_of_a_publisher_that_is_gone(
    server: ServerProcess, tf: TransformClient, start_peer: StartPeer
) -> None:
    """After the grace, its links pass to another one that has sent them, or leave the tree."""
    first, second = start_peer(server.endpoint), start_peer(server.endpoint)
    second.node("n", "heir")
    second.send_static("n", [("gone_base", "gone_both", 1, AHEAD)])
    wait_until(lambda: "gone_both" in tf.frames())
    first.node("n", "heir", 0, "first")
    first.send_static(
        "n",
        [
            ("gone_base", "gone_both", 1, (2.0, *AHEAD[1:])),
            ("gone_base", "gone_alone", 1, AHEAD),
            ("gone_alone", "gone_below", 1, AHEAD),
        ],
    )
    wait_until(lambda: {"gone_alone", "gone_below"} <= set(tf.frames()))
    wait_until(lambda: position(tf, "gone_base", "gone_both") == [2.0, 0.0, 0.0])
    first.kill()
    wait_until(lambda: not {"gone_alone", "gone_below"} & set(tf.frames()))
    wait_until(lambda: position(tf, "gone_base", "gone_both") == [1.0, 0.0, 0.0])
    assert tf.frame("gone_both").authority == "ros2:0/heir/robot"
    assert tf.stats()["ros2_statics_dropped"] >= 2


def test_malformed_messages_are_counted_and_named(
    server: ServerProcess, tf: TransformClient, peer: Peer
) -> None:
    before = tf.stats()
    key, good = KEY % "bad/tf", peer_message("bad_odom", "bad_base")
    peer.put(key, good[:-2])
    peer.put(KEY % "bad/tf_static", good[:-2])
    peer.put(key, encode_joint_state(JointState([], [])).hex())  # type: ignore[arg-type]
    peer.put(f"0/bad/tf/{TF_MESSAGE.chunk}/too/many", good)
    peer.put(f"zero/bad/tf/{TF_MESSAGE.chunk}/{NO_HASH}", good)  # no domain
    peer.put("bad name/tf", good)
    peer.put(key, good, "00")

    def counted() -> bool:
        after = tf.stats()
        wanted = {"bad_puts": 3, "ros2_bad_keys": 2, "ros2_bad_attachments": 1}
        return all(after[name] - before[name] == count for name, count in wanted.items())

    wait_until(counted)
    bad = authorities(tf)["ros2:0/bad/tf"]
    assert "CDR field" in str(bad.last_refusal)
    server.wait_for_log("is not of ROS 2")
    assert position(tf, "bad_odom", "bad_base") == [1.0, 0.0, 0.0]  # of the bad attachment


def test_own_keys_are_not_taken_for_a_bridge(server: ServerProcess, tf: TransformClient) -> None:
    before = tf.stats()
    broadcaster = tf.broadcaster("tf")
    broadcaster.send([StampedTransform("own_a", "own_b", time.time_ns(), Transform())])
    wait_until(lambda: "own_b" in tf.frames())
    after = tf.stats()
    assert all(after[name] == before[name] for name in ("bad_puts", "ros2_bad_keys"))
    assert after["ros2_messages"] == before["ros2_messages"]


def test_a_burst(tf: TransformClient, peer: Peer) -> None:
    peer.node("n", "burst")
    before = tf.stats()
    peer.burst("n", 2000, 10)
    wait_until(lambda: tf.stats()["put_transforms"] - before["put_transforms"] == 20_000)
    assert tf.stats()["dropped_by_queue"] == before["dropped_by_queue"]


# --- networks with a router of their own, which the server joins


def test_statics_from_before_the_server_and_a_publisher_that_stalls(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    endpoint = free_endpoint()
    start_peer(endpoint, "router")
    staller = start_peer(endpoint)
    staller.stall("0/stall/tf_static")
    robots = [start_peer(endpoint) for _ in range(2)]
    for number, robot in enumerate(robots):  # on one key, which both keep for late subscribers
        robot.node("n", "", 0, f"robot{number}")
        robot.send_static("n", [("base", f"early{number}", 1, AHEAD)])
    bridge = start_peer(endpoint, "bridge")
    bridge.bridge("b", "")
    for number in range(3):
        bridge.send_static("b", [("base", f"bridged{number}", 1, AHEAD)])
    server = start_server("--ros2", "--connect", endpoint, endpoint=endpoint)
    with server.connect() as tf:
        for child in ("early0", "early1", "bridged0", "bridged1", "bridged2"):
            assert position(tf, "base", child) == [1.0, 0.0, 0.0]
        assert staller.was_asked()
        robots[0].send_static("n", [("base", "early0", 1, AHEAD), ("base", "late", 1, AHEAD)])
        assert position(tf, "base", "late") == [1.0, 0.0, 0.0]
        names = authorities(tf)
        assert names["ros2:0/robot0"].stored == 2 and names["ros2:0/robot1"].stored == 1


def test_an_old_bridge_that_was_there_before_the_server(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    endpoint = free_endpoint()
    start_peer(endpoint, "router")
    bridge = start_peer(endpoint, "bridge")
    bridge.bridge("b", "first", "queryable")
    bridge.send_static("b", [("base", "kept", 1, AHEAD)])
    server = start_server("--ros2", "--connect", endpoint, endpoint=endpoint)
    with server.connect() as tf:
        assert position(tf, "base", "kept", 10.0) == [1.0, 0.0, 0.0]


def test_a_router_that_restarts_takes_no_statics_away(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    endpoint = free_endpoint()
    router = start_peer(endpoint, "router")
    robot = start_peer(endpoint)
    robot.node("n", "router")
    robot.send_static("n", [("base", "kept", 1, AHEAD)])
    flags = ("--ros2", "--connect", endpoint, "--ros2-static-grace", "20s")
    server = start_server(*flags, endpoint=endpoint)
    with server.connect() as tf:
        position(tf, "base", "kept")
        router.kill()
        start_peer(endpoint, "router")
        robot.send_static("n", [("base", "new", 1, AHEAD)])
        assert position(tf, "base", "new", 40.0) == [1.0, 0.0, 0.0]
        assert tf.stats()["ros2_statics_dropped"] == 0
        assert authorities(tf)["ros2:0/router/robot"].stored == 2


class WithoutHashes(ServerProcess):
    """A server without the extra ``zenoh-tf[ros2]``."""

    START = (
        "-c",
        "import sys; sys.modules['xxhash'] = None; from zenoh_tf_server.main import main; main()",
    )


def test_without_the_extra_a_topic_with_one_publisher_tells_the_node(
    tmp_path: Path, start_peer: StartPeer
) -> None:
    server = WithoutHashes(tmp_path / "server.log", free_endpoint(), "main", ("--ros2",))
    try:
        peers = [start_peer(server.endpoint) for _ in range(3)]
        peers[0].node("n", "alone")
        for number in (1, 2):
            peers[number].node("n", "shared", 0, f"node{number}")
        with server.connect() as tf:
            wait_until(lambda: tf.stats()["ros2_publishers"] == 6)
            for number, peer in enumerate(peers):
                peer.send_static("n", [(f"base{number}", f"arm{number}", 1, AHEAD)])
                peer.send("n", [(f"odom{number}", f"base{number}", time.time_ns(), AHEAD)])
                position(tf, f"odom{number}", f"arm{number}")
            names = set(authorities(tf))
            assert "ros2:0/alone/robot" in names
            # Their static transforms carry the session, their /tf only an id.
            assert {"ros2:0/shared/node1", "ros2:0/shared/node2"} < names
            assert len([name for name in names if name.startswith("ros2:0/shared/tf#")]) == 2
    finally:
        server.stop()
