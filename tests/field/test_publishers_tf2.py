"""Scripts of the field that use tf2_ros as of ROS 2 Lyrical."""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from tests.processes import forks
from tests.processes.servers import ServerProcess
from zenoh_tf_client import tf2
from zenoh_tf_client.client import TransformClient


@pytest.fixture
def shim(
    shared_server: ServerProcess, monkeypatch: pytest.MonkeyPatch
) -> Iterator[TransformClient]:
    """The process's connection leads to `shared_server`, which holds nothing but names."""
    monkeypatch.setenv("ZENOH_TF_CONNECT", shared_server.endpoint)
    client = tf2.connect()
    client.clear(keep_static=False)
    yield client
    tf2.close()


def link(parent: str, child: str, sec: int, x: float) -> tf2.TransformStamped:
    message = tf2.TransformStamped(tf2.Header(tf2.Time(sec), parent), child)
    message.transform.translation.x = x
    return message


def listener(name: str, buffer: tf2.BufferInterface) -> tf2.TransformListener:
    """As the scripts make theirs."""
    node = SimpleNamespace(get_name=lambda: "calibration")
    if name == "a class of its own":
        return tf2.StaticTransformListener(buffer, node, spin_thread=True, static_qos=10)
    if name == "a flag":
        return tf2.TransformListener(buffer, node, spin_thread=True, static_only=True)
    return tf2.TransformListener(buffer, None, tf_topic="/tf", tf_static_topic="tf_static")


@pytest.mark.parametrize("name", ["a class of its own", "a flag", "topics"])
def test_a_listener_of_the_calibration_only(shim: TransformClient, name: str) -> None:
    """ros2/geometry2#719, #673 and #906: the names and keywords exist, and a static lookup at
    Time(0) is stamped 0, whatever stamp the link was sent with."""
    buffer = tf2.Buffer()
    made = listener(name, buffer)
    assert made.buffer is buffer
    tf2.StaticTransformBroadcaster().sendTransform(
        [link("base_link", "mast", 1_700_000_000, 0.2), link("mast", "camera", 0, 0.1)]
    )
    for source, x in (("camera", 0.3), ("mast", 0.2)):
        got = buffer.lookup_transform("base_link", source, tf2.Time(), tf2.Duration(seconds=30))
        assert got.header.stamp == tf2.Time(0, 0)
        assert got.transform.translation.x == pytest.approx(x)
    made.unregister()


@pytest.mark.parametrize("field", ["tf_topic", "tf_static_topic"])
def test_another_topic_is_refused(field: str) -> None:
    """ros2/geometry2#719 with topics of one's own: silence would be another robot's tree."""
    options: dict[str, Any] = {field: "/robot1/tf"}
    with pytest.raises(tf2.InvalidArgumentException, match="ZENOH_TF_TREE") as refusal:
        tf2.TransformListener(tf2.Buffer(), None, **options)
    assert refusal.value.field == field


class Offline(tf2.BufferInterface):
    """A buffer of a script: it knows one link, and not whether there are others."""

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> tf2.TransformStamped:
        return link(target_frame, source_frame, 3, 2.0)


def make_buffer(kind: str) -> tf2.BufferInterface:
    """A factory as of ros-navigation/navigation2#6281: callers know the interface only."""
    if kind == "client":
        return tf2.BufferClient(object(), "tf2_buffer_server", check_frequency=5.0)
    return Offline() if kind == "offline" else tf2.Buffer()


@pytest.mark.parametrize("kind", ["buffer", "client", "offline"])
def test_a_factory_of_buffers(shim: TransformClient, kind: str) -> None:
    """ros-navigation/navigation2#6281 and ros2/geometry2#719: any buffer transforms messages."""
    tf2.Buffer().set_transform(link("map", "base", 3, 2.0), "odometry")
    buffer = make_buffer(kind)
    assert isinstance(buffer, tf2.BufferInterface)
    header = tf2.Header(tf2.Time(3), "base")
    point = buffer.transform(tf2.PointStamped(header, tf2.Point(1.0, 2.0)), "map")
    assert point == tf2.PointStamped(tf2.Header(tf2.Time(3), "map"), tf2.Point(3.0, 2.0))
    pose = buffer.transform(tf2.PoseStamped(header, tf2.Pose(tf2.Point(y=5.0))), "map")
    assert pose.pose.position == tf2.Point(2.0, 5.0, 0.0)


@pytest.mark.parametrize("method", ["lookup_transform_full", "can_transform", "can_transform_full"])
def test_a_method_that_a_buffer_lacks(method: str) -> None:
    """ros-navigation/navigation2#6281: the error names the class and the method."""
    arguments = ["map", tf2.Time(), "base", tf2.Time(), "odom"]
    if method == "can_transform":
        arguments = ["map", "base", tf2.Time()]
    with pytest.raises(tf2.NotImplementedException, match=f"Offline does not implement {method}"):
        getattr(Offline(), method)(*arguments)


@pytest.mark.parametrize("corners", [0, 1, 4])
def test_a_footprint(shim: TransformClient, corners: int) -> None:
    """ros2/geometry2#719: `do_transform_polygon_stamped`, also as `Buffer.transform`."""
    points = [SimpleNamespace(x=float(n), y=0.5, z=0.0) for n in range(corners)]
    header = tf2.Header(tf2.Time(1), "base")
    footprint = SimpleNamespace(header=header, polygon=SimpleNamespace(points=points))
    tf2.Buffer().set_transform(link("map", "base", 1, 10.0), "odometry")
    direct = tf2.do_transform_polygon_stamped(footprint, link("map", "base", 1, 10.0))
    for got in (direct, tf2.Buffer().transform(footprint, "map")):
        assert [(p.x, p.y) for p in got.polygon.points] == [(10.0 + n, 0.5) for n in range(corners)]
        assert got.header.frame_id == "map"
    assert footprint.header.frame_id == "base"  # a copy


@pytest.mark.parametrize("way", ["filter", "future"])
def test_waiting_fails_where_the_process_has_no_file_left(shared_server: Any, way: str) -> None:
    """The loop that waits cannot start: the caller gets an error, and later calls work."""
    environment = os.environ | {"ZENOH_TF_CONNECT": shared_server.endpoint}
    command = [sys.executable, __file__, way]
    done = forks.run(command, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr  # Python itself warns of a loop without files
    assert done.stdout.splitlines() == ["ServiceException", "then it works: map base"]


def wait_without_files(way: str) -> None:
    """Ask with no file left, then with some again."""
    buffer = tf2.Buffer()
    buffer.set_transform(link("map", "base", 1, 1.0), "wheels")
    buffer.lookup_transform("map", "base", tf2.Time(1))
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    held = []
    try:
        while True:
            held.append(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        pass
    outcome: list[BaseException] = []

    def ask() -> None:
        try:
            if way == "filter":
                tf2.TransformFilter(None, buffer, "map", 1)
            else:
                buffer.wait_for_transform_async("map", "base", tf2.Time(1)).result()
        except BaseException as error:
            outcome.append(error)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(60)
    for each in held:
        os.close(each)
    print(type(outcome[0]).__name__ if outcome else "hangs", flush=True)
    got = buffer.wait_for_transform_async("map", "base", tf2.Time(1)).result(60)
    print("then it works:", got.header.frame_id, got.child_frame_id)


if __name__ == "__main__":
    wait_without_files(sys.argv[1])
