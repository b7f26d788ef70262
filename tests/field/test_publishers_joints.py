"""Robots of the field on whose /joint_states two nodes publish.

automaticaddison/yahboom_rosmaster#4 and clearpathrobotics/clearpath_robot#222."""

from __future__ import annotations

import itertools
import json
import math
import signal
import struct
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.processes.servers import ServerProcess
from tests.support import command_line
from tests.support.joint_states import HASH, TYPE, encode
from tests.support.waiting import wait_until
from zenoh_tf.urdf import reader
from zenoh_tf.urdf.kinematics import JointTransforms
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.joint_states import JointStateFeed

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "examples/arm.urdf"
sys.path.insert(0, str(ROOT / "examples"))

from ros2_robot import gid_of, open_session  # noqa: E402 - it is in that folder

_numbers = itertools.count(1)


class Sender:
    """A publisher of /joint_states of a node of rmw_zenoh."""

    def __init__(self, session: zenoh.Session, node: str) -> None:
        token = (
            f"@ros2_lv/0/{session.zid()}/0/{next(_numbers)}/MP/%/%/{node}/%joint_states/{TYPE}"
            f"/{HASH}/1:2:1,10:,:,:,,"
        )
        self._token = session.liveliness().declare_token(token)
        self._publisher = session.declare_publisher(f"0/joint_states/{TYPE}/{HASH}")
        self._gid = gid_of(token)
        self._sent = 0

    def send(self, names: Sequence[str], positions: Sequence[float], stamp_ns: int) -> None:
        self._sent += 1
        mark = struct.pack("<qqB16s", self._sent, time.time_ns(), 16, self._gid)
        self._publisher.put(encode(names, positions, stamp_ns), attachment=mark)


@pytest.fixture
def session(shared_server: ServerProcess) -> Iterator[zenoh.Session]:
    with open_session(shared_server.endpoint) as session:
        yield session


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as tf:
        tf.reset()
        yield tf


class Sending:
    """Two nodes that send until the end of the test, at 50 Hz each."""

    def __init__(self, session: zenoh.Session, joints: Sequence[str], delay_ns: int) -> None:
        self._real = Sender(session, "broadcaster")
        self._zeros = Sender(session, "joint_state_publisher")
        self._joints, self._delay_ns = joints, delay_ns
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        names = self._joints
        while not self._end.wait(0.02):
            now_ns = time.time_ns()
            angle = 1.0 + 0.1 * math.sin(now_ns / 1e9)
            self._real.send(names, [angle] * len(names), now_ns)
            self._zeros.send(names, [0.0] * len(names), now_ns + self._delay_ns)


@pytest.fixture
def sending(request: pytest.FixtureRequest, session: zenoh.Session) -> Iterator[Sending]:
    started = Sending(session, *request.param)
    yield started
    started.close()


#: The joints, and how much later the zeros are stamped.
CASES = {
    "one joint, equal stamps": (["pan"], 0),
    "an arm, 7 ms later": (["roll", "wheel", "pan"], 7_000_000),
}
two_nodes = pytest.mark.parametrize("sending", CASES.values(), ids=CASES, indirect=True)


@two_nodes
def test_the_command_names_the_joint_and_both_nodes(
    tf: TransformClient, sending: Sending, request: pytest.FixtureRequest
) -> None:
    """automaticaddison/yahboom_rosmaster#4"""
    command = ("urdf", str(ARM), "--json", "--connect", tf.endpoint, "--joint-states")
    process = command_line.begun(*command)
    assert process.stderr is not None
    while "two nodes send" not in (line := process.stderr.readline()):
        assert line
    joints = request.node.callspec.params["sending"][0]
    assert f"two nodes send joint '{joints[0]}'" in line
    assert "ros2:0/joint_state_publisher" in line and "ros2:0/broadcaster" in line
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    document = json.loads(out)
    moving = [joint for joint in joints if joint != "wheel"]
    assert sorted(document["disputed"]) == sorted(moving)
    assert document["counts"]["disputed_joints"] == len(moving)


@pytest.fixture
def feed(tf: TransformClient) -> Iterator[JointStateFeed]:
    started = JointStateFeed(tf, JointTransforms(reader.read(ARM)), "urdf/arm")
    yield started
    started.close()


@two_nodes
def test_the_doctor_names_both_nodes(
    tf: TransformClient, feed: JointStateFeed, sending: Sending
) -> None:
    """automaticaddison/yahboom_rosmaster#4: a fault of two publishers, not of "the" publisher."""
    wait_until(lambda: feed.disputed)
    names = {each.name for each in tf.authorities()}
    senders = {"urdf/arm/ros2:0/broadcaster", "urdf/arm/ros2:0/joint_state_publisher"}
    assert senders <= names
    done = command_line.run("doctor", "--for", "1s", "--json", "--connect", tf.endpoint)
    findings: list[dict[str, Any]] = json.loads(done.stdout)["findings"]
    found = {each["id"] for each in findings}
    assert "TF101" in found
    assert not found & {"TF203", "TF209", "TF205", "TF202"}
    for finding in findings:
        if finding["id"] == "TF101":
            assert all(sender in finding["evidence"] for sender in senders)


@pytest.mark.parametrize("joints", [(["pan"], ["elbow"]), (["pan", "roll"], ["left"])])
def test_two_nodes_with_joints_of_their_own_are_no_fault(
    session: zenoh.Session, feed: JointStateFeed, joints: tuple[list[str], list[str]]
) -> None:
    """clearpathrobotics/clearpath_robot#222: an arm and a base, each with its controller."""
    senders = [Sender(session, name) for name in ("arm", "base")]

    def sent() -> bool:
        for sender, names in zip(senders, joints, strict=True):
            sender.send(names, [0.1] * len(names), time.time_ns())
        return feed.counts.messages > 20

    wait_until(sent)
    assert feed.disputed == {}


def test_a_node_that_replaces_another_one_is_no_fault(
    session: zenoh.Session, feed: JointStateFeed
) -> None:
    """automaticaddison/yahboom_rosmaster#4, after one of the two was ended."""
    for count, name in enumerate(("joint_state_publisher", "broadcaster"), start=1):
        sender = Sender(session, name)

        def sent(sender: Sender = sender, count: int = count) -> bool:
            sender.send(["pan"], [0.1], time.time_ns())
            return feed.counts.messages > 10 * count

        wait_until(sent)
    assert feed.disputed == {}
