"""``zenoh-tf urdf --joint-states`` with messages as ROS 2's nodes and bridges send them.

The keys, attachments and CDR are those of rmw_zenoh and zenoh-bridge-ros2dds; rosbags, not the
project, encodes the messages.
"""

from __future__ import annotations

import contextlib
import json
import signal
import struct
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from tests.processes.servers import ServerProcess
from tests.support import command_line
from tests.support.joint_states import HASH, TYPE, encode
from tests.support.waiting import wait_until
from zenoh_tf._net import zenoh_config
from zenoh_tf.urdf import reader
from zenoh_tf.urdf.kinematics import JointTransforms
from zenoh_tf_client import TransformClient
from zenoh_tf_tools.joint_states import JointStateFeed

ARM = Path(__file__).resolve().parents[2] / "examples/arm.urdf"
CASES: list[dict[str, Any]] = json.loads(Path(__file__).with_name("poses.json").read_text())
KEYS = {
    "newer": f"0/joint_states/{TYPE}/{HASH}",
    "Humble": f"42/joint_states/{TYPE}/TypeHashNotSupported",
    "bridge": "joint_states",
}


@contextlib.contextmanager
def robot_at(endpoint: str) -> Iterator[Callable[..., None]]:
    """``publish(key, payload)`` of a node of rmw_zenoh, or of a bridge, which attaches nothing."""
    with zenoh.open(zenoh_config.client([endpoint], 5.0)) as session:
        sent = 0

        def publish(key: str, payload: bytes) -> None:
            nonlocal sent
            sent += 1
            attachment = struct.pack("<qqB16s", sent, time.time_ns(), 16, b"g" * 16)
            session.put(key, payload, attachment=attachment if TYPE in key else None)

        yield publish


@pytest.fixture(scope="module")
def publish(shared_server: ServerProcess) -> Iterator[Callable[..., None]]:
    with robot_at(shared_server.endpoint) as publish:
        yield publish


@pytest.fixture
def feed(tf: TransformClient) -> Iterator[Callable[..., JointStateFeed]]:
    with contextlib.ExitStack() as open_feeds:

        def start(**options: Any) -> JointStateFeed:
            joints = JointTransforms(reader.read(ARM))
            started = JointStateFeed(tf, joints, "arm", **options)
            open_feeds.callback(started.close)
            return started

        yield start


def send_until(condition: Callable[[], object], send: Callable[[], object]) -> None:
    """Zenoh connects subscribers and publishers in its own time."""
    while not condition():
        send()
        time.sleep(0.05)


def has(tf: TransformClient, child: str, stamp_ns: int) -> bool:
    """Whether a link has a sample at a time."""
    return child in tf.frames() and (tf.frame(child).newest_stamp_ns or 0) >= stamp_ns


def counted(feed: JointStateFeed, counter: str, before: int) -> bool:
    """Whether a counter has grown."""
    return int(getattr(feed.counts, counter)) > before


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("peer", KEYS)
def test_a_message_moves_the_robot(
    tf: TransformClient, publish: Any, feed: Any, peer: str, order: str
) -> None:
    case, stamp_ns = CASES[0], time.time_ns()
    payload = encode(list(case["positions"]), list(case["positions"].values()), stamp_ns, order)
    started = feed()
    send_until(partial(has, tf, "knuckle", stamp_ns), partial(publish, KEYS[peer], payload))
    for parent, child in (("shoulder", "forearm"), ("wrist", "knuckle"), ("tool", "right_finger")):
        a, b = (np.array(case["poses"][link]) for link in (parent, child))
        got = tf.lookup_transform(parent, child, stamp_ns)
        np.testing.assert_allclose(got.transform.matrix(), np.linalg.inv(a) @ b, atol=1e-9)
    authority = "arm/ros2dds:/" if peer == "bridge" else "arm/ros2:"
    assert str(tf.frame("forearm").authority).startswith(authority)
    assert started.counts.malformed == 0


def test_a_message_is_one_commit(tf: TransformClient, publish: Any, feed: Any) -> None:
    """All its joints are there at once: the transaction finds one stamp."""
    feed()
    for number in range(20):
        stamp_ns = time.time_ns()
        payload = encode(["pan", "elbow"], [0.1 * number, 0.2], stamp_ns)
        send_until(
            partial(has, tf, "forearm", stamp_ns),
            partial(publish, KEYS["newer"], payload),
        )
        found = tf.lookup_latest_transform_xact("shoulder", "forearm")
        assert found.stamp_ns == found.newest_stamp_ns == stamp_ns


def test_other_namespaces_and_domains(tf: TransformClient, publish: Any, feed: Any) -> None:
    started = feed(topic="robot1/joint_states/", domain=42)
    stamp_ns = time.time_ns()
    for key in (
        f"42/joint_states/{TYPE}/{HASH}",
        f"42/robot2/joint_states/{TYPE}/{HASH}",
        f"0/robot1/joint_states/{TYPE}/{HASH}",
        "robot2/joint_states",
    ):
        count = started.counts.other_topics
        payload = encode(["pan"], [1.0], stamp_ns)
        send_until(
            partial(counted, started, "other_topics", count),
            partial(publish, key, payload),
        )
    assert tf.frames() == []
    assert started.counts.messages == 0
    assert "joint_states" in started.other_topic
    for key in (f"42/robot1/joint_states/{TYPE}/{HASH}", "robot1/joint_states"):
        stamp_ns = time.time_ns()
        payload = encode(["pan"], [1.0], stamp_ns)
        send_until(
            partial(has, tf, "upper_arm", stamp_ns),
            partial(publish, key, payload),
        )


BAD: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "malformed"),
    "noise": (bytes(range(256)), "malformed"),
    "cut off": (encode(["pan", "elbow"], [1.0, 2.0], 1)[:-6], "malformed"),
    "another length": (encode(["pan", "elbow"], [1.0], 1), "malformed"),
    "no positions": (encode(["pan"], [], 1), "no_positions"),
    "no stamp": (encode(["pan"], [1.0], 0), "no_stamp"),
    "many joints": (encode(["pan"] * 10_001, [1.0] * 10_001, 1), "not_sent"),
}


def test_bad_messages_are_counted_and_named(tf: TransformClient, publish: Any, feed: Any) -> None:
    started = feed()
    for name, (payload, counter) in BAD.items():
        before = getattr(started.counts, counter)
        send_until(
            partial(counted, started, counter, before),
            partial(publish, KEYS["newer"], payload),
        )
        assert tf.frames() == [], name
    assert "10000" in started.last_error
    stamp_ns = time.time_ns()
    payload = encode(["pan"], [1.0], stamp_ns)
    send_until(partial(has, tf, "upper_arm", stamp_ns), partial(publish, KEYS["newer"], payload))


class Command:
    """The command as a process."""

    def __init__(self, *args: str) -> None:
        self.process = command_line.begun("urdf", str(ARM), *args)
        assert self.process.stderr is not None
        self.errors = self.process.stderr
        self.listening = self.errors.readline()

    def line_with(self, text: str) -> str:
        """The next line on stderr that has a text."""
        while text not in (line := self.errors.readline()):
            assert line, f"ended without {text!r}"
        return line

    def interrupt(self) -> str:
        self.process.send_signal(signal.SIGINT)
        out, _ = self.process.communicate(timeout=30)
        assert self.process.returncode == -signal.SIGINT
        return out


@pytest.fixture
def command(tf: TransformClient) -> Iterator[Callable[..., Command]]:
    started: list[Command] = []

    def start(*args: str, endpoint: str = tf.endpoint) -> Command:
        started.append(Command("--connect", endpoint, "--joint-states", *args))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.kill()
            one.process.communicate()


def test_the_command(tf: TransformClient, publish: Any, command: Any) -> None:
    running = command("--prefix", "r1")
    assert running.listening == "listening to /joint_states; Ctrl-C ends it\n"
    assert tf.frame("r1/camera").static
    stamp_ns = time.time_ns()
    payload = encode(["pan", "wheel", "elbow"], [1.0, 2.0, 1.6], stamp_ns)
    send_until(partial(has, tf, "r1/forearm", stamp_ns), partial(publish, KEYS["newer"], payload))
    assert "left out, such as 'wheel'" in running.line_with("zenoh-tf: ")
    assert "beyond the limits are published all the same, such as that of 'elbow'" in (
        running.line_with("zenoh-tf: ")
    )
    out = running.interrupt()
    assert "3 joints stored as static, root frame r1/base\n7 joints that move: pan" in out
    assert "unknown_joints" in out
    assert "beyond_limits" in out


def test_the_command_names_the_topic_that_there_is(publish: Any, command: Any) -> None:
    running = command("/joint_states", "--json")
    payload = encode(["pan"], [1.0], 1)

    for _ in range(1000):
        publish(f"7/robot1/joint_states/{TYPE}/{HASH}", payload)
        time.sleep(0.002)
    line = running.line_with("no message on /joint_states, but")
    assert "but on /robot1/joint_states of domain 7: name that topic" in line
    document = json.loads(running.interrupt())
    assert document["counts"]["messages"] == 0
    assert document["counts"]["other_topics"] > 0
    assert document["root"] == "base"


def test_a_restarted_server_gets_everything_again(start_server: Any, command: Any) -> None:
    server = start_server()
    running = command(endpoint=server.endpoint)
    server.kill()
    server = start_server(endpoint=server.endpoint)
    with robot_at(server.endpoint) as publish, server.connect() as tf:
        wait_until(lambda: "camera" in tf.frames())
        stamp_ns = time.time_ns()
        payload = encode(["pan"], [1.0], stamp_ns)
        send_until(
            partial(has, tf, "upper_arm", stamp_ns), partial(publish, KEYS["bridge"], payload)
        )
    running.interrupt()
