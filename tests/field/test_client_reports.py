"""Public reports about clients: their processes, threads, waits, and scripts of tf2."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from ruamel.yaml import YAML

from tests.processes.servers import ServerProcess
from zenoh_tf import LookupException, StampedTransform, Transform
from zenoh_tf.errors import ServerUnavailable, TransformException
from zenoh_tf_client import TransformClient, tf2

S = 10**9


@pytest.fixture(scope="module")
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    """map -> base -> camera (static)."""
    with shared_server.connect() as tf:
        for second in (1, 2):
            tf.set_transform(StampedTransform("map", "base", second * S, Transform((second, 0, 0))))
        mount = StampedTransform("base", "camera", 0, Transform((0, 0, 1)))
        tf.set_transform(mount, static=True)
        yield tf


@pytest.fixture
def buffer(
    tf: TransformClient, shared_server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tf2.Buffer]:
    monkeypatch.setenv("ZENOH_TF_CONNECT", shared_server.endpoint)
    tf2.connect()
    yield tf2.Buffer()
    tf2.close()


CALLS = {
    "lookup": lambda tf: tf.lookup_transform("map", "camera"),
    "set": lambda tf: tf.set_transform(StampedTransform("map", "child", 1, Transform())),
    "wait": lambda tf: tf.lookup_transform("map", "camera", 9 * S, timeout_s=60.0),
}


@pytest.mark.parametrize("call", CALLS)
def test_a_forked_child_is_refused_and_does_not_hang(tf: TransformClient, call: str) -> None:
    """dimensionalOS/dimos#3395: a daemon forked after its session was open, and its requests waited
    for threads that only the parent had."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            CALLS[call](tf)
            said = "no error"
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        os.write(write, said.encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as answer:
        said = answer.read()
    os.waitpid(child, 0)
    assert said.startswith("ServerUnavailable: ") and "fork" in said
    assert tf.lookup_transform("map", "camera").transform.translation[2] == 1


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::ffff:127.0.0.1]"])
def test_the_name_of_this_machine(shared_server: ServerProcess, host: str) -> None:
    """gazebosim/gazebo-classic#483: the name has an address of IPv6 as well, where the server does
    not listen."""
    port = shared_server.endpoint.rpartition(":")[2]
    with TransformClient.connect(f"tcp/{host}:{port}") as tf:
        assert tf.stats()["frames"] >= 0


@pytest.mark.parametrize(("target", "fixed"), [("base", "nowhere"), ("camera", "no_odom")])
def test_a_full_lookup_over_an_unknown_frame_ends(
    tf: TransformClient, buffer: tf2.Buffer, target: str, fixed: str
) -> None:
    """ros2/geometry2#185: with a timeout it blocked for ever."""
    with pytest.raises(LookupException, match=f"'{fixed}' does not exist"):
        tf.lookup_transform_full(target, None, "base", None, fixed, timeout_s=0.1)
    zero, wait = tf2.Time(), tf2.Duration(seconds=0.1)
    with pytest.raises(tf2.LookupException, match=fixed):
        buffer.lookup_transform_full(target, zero, "base", zero, fixed, wait)


@pytest.mark.parametrize("frame", ["camera", "not_yet"])
def test_a_client_is_closed_while_another_thread_waits(
    shared_server: ServerProcess, frame: str
) -> None:
    """ros2/geometry2#73, mowglinext/mowglinext#734: the end of a listener waited for its thread."""
    tf = TransformClient.connect(shared_server.endpoint)
    ended: list[BaseException] = []

    def wait() -> None:
        try:
            tf.lookup_transform("map", frame, 99 * S, timeout_s=600.0)
        except TransformException as error:
            ended.append(error)

    waiting = threading.Thread(target=wait)
    waiting.start()
    while tf.stats()["waiters"] == 0:
        time.sleep(0.01)
    tf.close()
    tf.close()
    waiting.join(60)
    assert isinstance(ended[0], ServerUnavailable)


class RclpyTime:
    """As rclpy.time.Time: a number, and a method for the message."""

    def __init__(self, nanoseconds: int) -> None:
        self.nanoseconds = nanoseconds

    def to_msg(self) -> Any:
        return SimpleNamespace(sec=self.nanoseconds // S, nanosec=self.nanoseconds % S)


@pytest.mark.parametrize("kind", [tf2.Buffer, tf2.BufferClient])
@pytest.mark.parametrize("stamp_ns", [1_500_000_000, 0])
def test_times_of_either_library(buffer: tf2.Buffer, kind: type, stamp_ns: int) -> None:
    """ros2/geometry2#598, #318: one buffer took `rclpy.time.Time`, the other the message, so that a
    header's stamp worked in one of them."""
    one = buffer if kind is tf2.Buffer else tf2.BufferClient(None, "tf2_buffer_server")
    expected = 1.5 if stamp_ns else 2.0
    for stamp in (RclpyTime(stamp_ns), RclpyTime(stamp_ns).to_msg()):
        found = one.lookup_transform("map", "camera", stamp)
        assert found.transform.translation.x == expected
        assert one.can_transform("map", "camera", stamp)


def pose(x: float, yaw: tuple[float, float]) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=yaw[0], w=yaw[1])
    return SimpleNamespace(position=SimpleNamespace(x=x, y=0.0, z=0.0), orientation=turn)


@pytest.mark.parametrize("x", [1.0, -3.5])
def test_a_pose_with_a_header_and_one_without(buffer: tf2.Buffer, x: float) -> None:
    """ros2/geometry2#707: `do_transform_pose` took PoseStamped in one release and Pose in the
    next, and `transform` failed with AttributeError."""
    transform = buffer.lookup_transform("map", "camera", tf2.Time(2))
    header = SimpleNamespace(stamp=tf2.Time(2), frame_id="camera")
    with_header = SimpleNamespace(header=header, pose=pose(x, (0.0, 1.0)))
    assert tf2.do_transform_pose(pose(x, (0.0, 1.0)), transform).position.x == x + 2
    moved = tf2.do_transform_pose(with_header, transform)
    assert (moved.header.frame_id, moved.pose.position.x) == ("map", x + 2)
    assert buffer.transform(with_header, "map").pose.position.x == x + 2
    assert with_header.pose.position.x == x


@pytest.mark.parametrize("is_there", [True, False])
def test_the_callback_of_a_wait_comes_in_any_case(
    tf: TransformClient, buffer: tf2.Buffer, is_there: bool
) -> None:
    """ros2/geometry2#346, #194: no callback was called if the transform was there already."""
    child = f"callback_{is_there}"
    later = StampedTransform("map", child, S, Transform((7, 0, 0)))
    if is_there:
        tf.set_transform(later)
    called = threading.Event()
    future = buffer.wait_for_transform_async("map", child, tf2.Time(1))
    future.add_done_callback(lambda _: called.set())
    if not is_there:
        tf.set_transform(later)
    assert called.wait(60)
    assert future.result().transform.translation.x == 7


@pytest.mark.parametrize("together", [True, False])
def test_statics_that_are_sent_one_by_one(
    shared_server: ServerProcess, buffer: tf2.Buffer, together: bool
) -> None:
    """ros/geometry2#33, ros2/geometry2#183: only the last call of one broadcaster was kept for
    those that came later."""
    prefix = "at_once" if together else "one_by_one"
    links = []
    for number in range(4):
        parent = "camera" if number == 0 else f"{prefix}_{number - 1}"
        link = tf2.TransformStamped(tf2.Header(tf2.Time(0), parent), f"{prefix}_{number}")
        link.transform.translation.x = 1.0
        links.append(link)
    broadcaster = tf2.StaticTransformBroadcaster()
    for call in [links] if together else links:
        broadcaster.sendTransform(call)
    with shared_server.connect() as late:
        found = late.lookup_transform("camera", f"{prefix}_3", timeout_s=30.0)
    assert found.transform.translation[0] == 4


@pytest.mark.parametrize(
    "name", ["Fixed Jaw 1", "robot::link::2", "カメラ", 'a"b\\c', "true", "1e3"]
)
def test_names_of_frames_are_kept(tf: TransformClient, buffer: tf2.Buffer, name: str) -> None:
    """TheRobotStudio/SO-ARM100#87, ros/joint_state_publisher#57: names with spaces, quotes, letters
    of any script, or that look like numbers, in lookups and in the YAML of all frames."""
    stamped = StampedTransform("map", name, 0, Transform((5, 0, 0)))
    tf.set_transform(stamped, static=True)
    assert tf.lookup_transform("map", name).transform.translation[0] == 5
    frames = YAML(typ="safe").load(buffer.all_frames_as_yaml())
    assert frames[name]["parent"] == "map"
    tf.remove_frame(name)
