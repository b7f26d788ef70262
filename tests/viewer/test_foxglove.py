"""``zenoh-tf foxglove``, by a WebSocket client that decodes what it gets."""

from __future__ import annotations

import base64
import json
import re
import signal
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.processes.ports import free_port
from tests.processes.servers import ServerProcess
from tests.support.command_line import call, documented, started
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

PAGE = Path(__file__).parents[2] / "docs/how-to/view.md"
S = 10**9
QUARTER = (0.0, 0.0, 0.5**0.5, 0.5**0.5)


class App:
    """As the Foxglove app: finds the schema, subscribes, decodes."""

    def __init__(self, socket: Connection) -> None:
        self._socket = socket
        self.transforms: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.status: list[dict[str, Any]] = []
        info = json.loads(socket.recv(10))
        assert info["op"] == "serverInfo"
        self.name = info["name"]
        advertised = json.loads(socket.recv(10))
        (self.channel,) = advertised["channels"]
        files = descriptor_pb2.FileDescriptorSet()
        files.ParseFromString(base64.b64decode(self.channel["schema"] + "=="))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        schema = pool.FindMessageTypeByName(self.channel["schemaName"])
        self._kind = message_factory.GetMessageClass(schema)
        wanted = [{"id": 7, "channelId": self.channel["id"]}]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def receive(self) -> None:
        """Take one message."""
        message = self._socket.recv(20)
        if isinstance(message, str):
            self.status.append(json.loads(message))
            return
        kind, subscription, self.log_ns = struct.unpack_from("<BIQ", message)
        assert (kind, subscription) == (1, 7)
        for transform in self._kind.FromString(message[13:]).transforms:
            self.transforms[transform.child_frame_id] = transform
            self.counts[transform.child_frame_id] = 1 + self.counts.get(transform.child_frame_id, 0)

    def wait_for(self, *frames: str) -> None:
        while not self.transforms.keys() >= {*frames}:
            self.receive()


@contextmanager
def bridge(server: ServerProcess) -> Iterator[str]:
    """The address of a running `zenoh-tf foxglove`."""
    where = ("--connect", server.endpoint, "--port", str(free_port()))
    with started("foxglove", *where) as (_, line):
        found = re.fullmatch(r"showing main at (ws://127.0.0.1:\d+) \(Ctrl-C ends it\)\n", line)
        assert found, line
        yield found[1]


@pytest.fixture(scope="module")
def url(shared_server: ServerProcess) -> Iterator[str]:
    with bridge(shared_server) as url:
        yield url


@pytest.fixture
def tf(shared_server: ServerProcess) -> Iterator[TransformClient]:
    with shared_server.connect() as tf:
        yield tf
        tf.clear(keep_static=False)


def app(url: str) -> Connection:
    return connect(url, subprotocols=["foxglove.sdk.v1"])  # type: ignore[list-item]


def test_a_client_decodes_the_tree(url: str, tf: TransformClient) -> None:
    stamp_ns = time.time_ns()
    mount = StampedTransform("base", "cam/\u00e4", 0, Transform((1, 2, 3), QUARTER))
    tf.set_transform(mount, static=True)
    tf.set_transform(StampedTransform("map", "base", stamp_ns, Transform((4, 5, 6))))
    with app(url) as socket:
        first = App(socket)
        assert first.name == "zenoh-tf main"
        assert first.channel["topic"] == "/tf"
        assert first.channel["schemaName"] == "foxglove.FrameTransforms"
        first.wait_for("base", "cam/\u00e4")
        base, camera = first.transforms["base"], first.transforms["cam/\u00e4"]
        assert base.parent_frame_id == "map"
        assert base.timestamp.seconds * S + base.timestamp.nanos == stamp_ns
        assert (base.translation.x, base.translation.y, base.translation.z) == (4, 5, 6)
        rotation = camera.rotation
        assert (rotation.x, rotation.y, rotation.z, rotation.w) == pytest.approx(QUARTER)
        assert abs(first.log_ns - time.time_ns()) < 60 * S
        # What changes comes at once; what does not change is not sent again and again.
        tf.set_transform(StampedTransform("map", "base", stamp_ns + S, Transform((7, 0, 0))))
        while first.transforms["base"].translation.x != 7:
            first.receive()
        # A second one gets the static link, too.
        with app(url) as other:
            second = App(other)
            second.wait_for("base", "cam/\u00e4")
            assert second.transforms["cam/\u00e4"].translation.z == 3


def test_every_new_subscriber_gets_stopped_links(url: str, tf: TransformClient) -> None:
    tf.set_transform(StampedTransform("map", "stopped", 5 * S, Transform((1, 0, 0))))
    for _ in range(2):
        with app(url) as socket:
            App(socket).wait_for("stopped")


def test_frames_that_appear_later(url: str, tf: TransformClient) -> None:
    with app(url) as socket:
        later = App(socket)
        tf.set_transform(StampedTransform("map", "a", 1, Transform()))
        later.wait_for("a")
        many = [StampedTransform("a", f"f{i}", 1, Transform()) for i in range(1200)]
        tf.set_transforms_xact(many)
        later.wait_for(*(stamped.child_frame for stamped in many))


def test_stamps_that_foxglove_cannot_show_are_reported(url: str, tf: TransformClient) -> None:
    tf.set_transform(StampedTransform("map", "far", -S, Transform()))
    tf.set_transform(StampedTransform("map", "near", 1, Transform()))
    with app(url) as socket:
        subscriber = App(socket)
        subscriber.wait_for("near")
        while not subscriber.status:
            subscriber.receive()
        assert subscriber.status[0]["op"] == "status"
        assert (
            "1 links not shown: stamps outside of 1970 to 2106, first 'far'"
            in (subscriber.status[0]["message"])
        )
        assert "far" not in subscriber.transforms


def test_a_silent_server_is_reported(server: ServerProcess, client: TransformClient) -> None:
    client.set_transform(StampedTransform("map", "base", 1, Transform()))
    with bridge(server) as url, app(url) as socket:
        subscriber = App(socket)
        subscriber.wait_for("base")
        server.freeze()
        while not subscriber.status:
            subscriber.receive()
        assert "no heartbeat from the server" in subscriber.status[0]["message"]


def test_garbage_harms_nobody(url: str, tf: TransformClient) -> None:
    tf.set_transform(StampedTransform("map", "base", 1, Transform()))
    for garbage in ("{", '{"op": "subscribe", "subscriptions": [{"id": 1}]}', b"\xff" * 1000):
        with app(url) as socket:
            socket.send(garbage)
            with app(url) as other:
                App(other).wait_for("base")


def test_it_is_interrupted_while_the_app_is_connected(shared_server: ServerProcess) -> None:
    where = ("--connect", shared_server.endpoint, "--port", str(free_port()), "--json")
    with started("foxglove", *where) as (process, line):
        with app(json.loads(line)["url"]) as socket:
            App(socket)
            process.send_signal(signal.SIGINT)
            output, errors = process.communicate(timeout=20)
        assert process.returncode == -signal.SIGINT
        assert (output, errors) == ("", "interrupted\n")


def test_a_port_that_is_taken(
    url: str, shared_server: ServerProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    port = url.rsplit(":", 1)[1]
    done = call(capsys, "foxglove", "--connect", shared_server.endpoint, "--port", port)
    assert done.returncode == 1
    assert f"zenoh-tf: cannot listen on '127.0.0.1' port {port}" in done.stderr


@pytest.mark.parametrize("line", documented(PAGE, "foxglove"))
def test_documented_lines(line: str, shared_server: ServerProcess) -> None:
    args = line.split()[1:]
    port = str(free_port())
    if "--port" in args:
        args[args.index("--port") + 1] = port
    else:
        args += ["--port", port]
    with started(*args, "--connect", shared_server.endpoint) as (_, first):
        assert first.startswith("showing main at ws://127.0.0.1:")
