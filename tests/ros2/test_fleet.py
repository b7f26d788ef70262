"""Robots with equal frame names under prefixes, and the recorded run through ROS 2."""

from __future__ import annotations

import time

import pytest

from tests.client.test_client_recorded import answer, ask
from tests.conftest import StartServer
from tests.processes.servers import ServerProcess
from tests.support.recorded import needs_recording, questions, transforms
from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient

from .conftest import AHEAD, Peer, StartPeer, authorities, position

RULES = ("namespace", "domain:7=seventh", "domain")
FLAGS = ("--ros2", "--ros2-shared", "map,world", *(f"--ros2-prefix={rule}" for rule in RULES))


def drive(peer: Peer, x: float) -> None:
    """All that a robot sends: it is `x` metres ahead of the map."""
    peer.send_static("n", [("base_link", "/laser", 1, AHEAD)])
    peer.send("n", [("/map", "base_link", time.time_ns(), (x, *AHEAD[1:]))])


def test_robots_with_equal_frames(server: ServerProcess, start_peer: StartPeer) -> None:
    for x, (namespace, domain) in enumerate([("robot1", 0), ("robot2", 0), ("", 7), ("", 3)]):
        peer = start_peer(server.endpoint)
        peer.node("n", namespace, domain)
        drive(peer, 10.0 * x)
    with server.connect() as tf:
        for x, prefix in enumerate(["robot1", "robot2", "seventh", "3"]):
            assert position(tf, "map", f"{prefix}/laser") == [10.0 * x + 1, 0, 0]
        assert "laser" not in tf.frames() and "base_link" not in tf.frames()
        assert all(each.conflicts == 0 for each in tf.authorities())


def test_frames_with_a_prefix_keep_it(server: ServerProcess, start_peer: StartPeer) -> None:
    peer = start_peer(server.endpoint)
    peer.node("n", "robot5")
    peer.send("n", [("map", "robot5/base_link", time.time_ns(), AHEAD)])
    with server.connect() as tf:
        assert position(tf, "map", "robot5/base_link") == [1.0, 0.0, 0.0]


def test_a_robot_that_no_rule_is_for(start_server: StartServer, start_peer: StartPeer) -> None:
    server = start_server("--ros2", "--ros2-prefix", "namespace")
    for namespace in ("", "robot5"):
        peer = start_peer(server.endpoint)
        peer.node("n", namespace)
        drive(peer, 0.0)
    with server.connect() as tf:
        assert position(tf, "robot5/base_link", "robot5/laser") == [1.0, 0.0, 0.0]
        assert position(tf, "base_link", "laser") == [1.0, 0.0, 0.0]
    warnings = [line for line in server.log.splitlines() if "no --ros2-prefix is for" in line]
    assert warnings and not [line for line in warnings if "robot5" in line]


@pytest.mark.parametrize("known", [True, False], ids=["known", "unknown"])
def test_prefixes_by_session(start_server: StartServer, start_peer: StartPeer, known: bool) -> None:
    """Equal robots, whose namespace and domain are the same; of one no token says who it is."""
    server = start_server("--ros2", "--ros2-prefix", "session")
    peer = start_peer(server.endpoint)
    zid = peer.node("n")
    if not known:
        from .test_in import KEY, peer_message  # noqa: PLC0415

        stranger = start_peer(server.endpoint)
        stranger.put(KEY % "tf", peer_message("map", "base_link"), "00" * 16 + "10" + "ee" * 16)
    drive(peer, 0.0)
    with server.connect() as tf:
        assert position(tf, f"{zid}/base_link", f"{zid}/laser") == [1.0, 0.0, 0.0]
        if not known:
            wait_until(lambda: tf.stats()["bad_puts"] == 1)
            refused = authorities(tf)["ros2:0/tf#eeeeeeee"].last_refusal
            assert "--ros2-prefix session" in str(refused)
        assert not {"map", "base_link"} & set(tf.frames())


@needs_recording
def test_the_recorded_run(start_server: StartServer, start_peer: StartPeer) -> None:
    """All messages of a real robot's recording; then tf2's answers about it."""
    server = start_server("--cache-time", "1000s", "--ros2")
    peer = start_peer(server.endpoint)
    peer.node("n")
    peer.reliable("n")
    sent = 0
    for static, stampeds in transforms():
        rows = [(s.parent_frame, s.child_frame, s.stamp_ns, s.transform.pose()) for s in stampeds]
        (peer.send_static if static else peer.send)("n", rows)
        sent += len(rows)
    with server.connect() as tf:
        wait_until(lambda: stored(tf) == sent)
        asked = questions()
        for start in range(0, len(asked), 250):
            with tf.batch() as batch:
                handles = [ask(batch, question) for question in asked[start : start + 250]]
            for question, handle in zip(asked[start : start + 250], handles, strict=True):
                question.check(answer(handle))


def stored(tf: TransformClient) -> int:
    return tf.stats()["put_transforms"]
