"""Publishers of ROS 2 that declare to keep their static transforms, and send none when asked."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.support.waiting import wait_until
from zenoh_tf_client import TransformClient

from .conftest import AHEAD, StartPeer, authorities, position

WARNING = "sent none when asked"


def wait_for_silent(tf: TransformClient, count: int) -> None:
    wait_until(lambda: tf.stats()["ros2_silent"] == count)


@pytest.mark.parametrize(
    "detected", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["without", "with"]
)
def test_a_restart_with_a_state_keeps_what_a_publisher_does_not(
    start_server: StartServer, start_peer: StartPeer, tmp_path: Path, detected: bool
) -> None:
    """With and without the token of publishers that can be asked."""
    endpoint = free_endpoint()
    flags = ("--ros2", "--state-dir", str(tmp_path / "state"))
    server = start_server(*flags, endpoint=endpoint)
    peer = start_peer(endpoint)
    peer.node("n", "bare", 0, "nav")
    peer.forget("n", detected)
    peer.send_static("n", [("bare_base", "bare_arm", 1, AHEAD)])
    for again in (False, True):
        if again:
            server.stop()
            server = start_server(*flags, endpoint=endpoint)
        with server.connect() as tf:
            assert position(tf, "bare_base", "bare_arm") == [1.0, 0.0, 0.0]
            assert "ros2:0/bare/nav" in authorities(tf)
            wait_for_silent(tf, 1)
            assert tf.stats()["ros2_unanswered"] == 0
            # It sends again, is asked once more, and still keeps nothing.
            peer.send_static("n", [("bare_base", f"bare_{again}", 1, AHEAD)])
            position(tf, "bare_base", f"bare_{again}")
            server.wait_for_log("/bare/tf_static of node /bare/nav: it declares")
            assert server.log.count(WARNING) == 1


def test_a_restart_without_a_state_is_seen(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    endpoint = free_endpoint()
    server = start_server("--ros2", endpoint=endpoint)
    peer = start_peer(endpoint)
    peer.node("n", "lost", 0, "nav")
    peer.forget("n", False)
    peer.send_static("n", [("lost_base", "lost_arm", 1, AHEAD)])
    with server.connect() as tf:
        position(tf, "lost_base", "lost_arm")
    server.stop()
    server = start_server("--ros2", endpoint=endpoint)
    with server.connect() as tf:
        wait_for_silent(tf, 1)
        assert tf.frames() == []
        server.wait_for_log("/lost/tf_static of node /lost/nav: it declares")
        assert "unless --state-dir has kept them" in server.log


def test_a_publisher_that_has_nothing_yet_is_asked_again(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    server = start_server("--ros2")
    peer = start_peer(server.endpoint)
    peer.node("n", "late", 0, "nav")
    with server.connect() as tf:
        wait_for_silent(tf, 1)
        peer.send_static("n", [("late_base", "late_arm", 1, AHEAD)])
        wait_for_silent(tf, 0)
        assert position(tf, "late_base", "late_arm") == [1.0, 0.0, 0.0]
        assert authorities(tf)["ros2:0/late/nav"].stored == 1  # and not again when it was asked
        assert server.log.count(WARNING) == 1


@pytest.mark.slow
def test_what_nobody_would_send_again_stays(
    start_server: StartServer, start_peer: StartPeer
) -> None:
    """A publisher that keeps its links loses them when it is gone; one that keeps none does not."""
    server = start_server("--ros2", "--ros2-static-grace", "0.5s")
    peer = start_peer(server.endpoint)
    for name, detected in (("keeps", None), ("plain", False), ("forgets", True)):
        peer.node(name, name, 0, name)
        if detected is not None:
            peer.forget(name, detected)
        peer.send_static(name, [(f"{name}_base", f"{name}_arm", 1, AHEAD)])
    with server.connect() as tf:
        wait_until(lambda: {"keeps_arm", "plain_arm", "forgets_arm"} <= set(tf.frames()))
        wait_for_silent(tf, 2)
        peer.kill()
        wait_for_silent(tf, 0)
        wait_until(lambda: "keeps_arm" not in tf.frames())
        assert {"plain_arm", "forgets_arm"} <= set(tf.frames())
