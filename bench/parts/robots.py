"""Emulated robots as processes: those that put their transforms, and those with a server of their
own that a site follows."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from bench.process import Process
from bench.server import session
from zenoh_tf import wire
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys
from zenoh_tf.wire import stream

FRAMES, RATE_HZ = 60, 100
#: The frames of a robot that has a server, a chain below the map.
SERVED = ("base", "arm", "camera")
_SETTINGS = wire.TreeSettings(10**10, 100, 1000, 255, 1000)
#: Stand for the number and the time of a message until it is sent.
_SEQ, _CLOCK_NS = 0x0102030405060708, 0x1112131415161718


def robots(
    endpoint: str, count: int, messages: int = 1, rate_hz: float = RATE_HZ, sessions: int = 1
) -> Process:
    """Robots that each put their frames in so many messages at a rate, with the time of the put as
    the stamp. They share so many sessions."""
    return Process.of(run_robots, messages, endpoint, count, rate_hz, sessions)


def robot_servers(endpoint: str, count: int, rate_hz: float, sessions: int) -> Process:
    """Servers of trees ``robots/rN`` on the network of a site. They share so many sessions."""
    return Process.of(run_robot_servers, endpoint, count, rate_hz, sessions)


def run_robots(messages: int, *rest: Any) -> None:
    children = np.array_split(np.arange(1, FRAMES + 1), messages)
    _run(lambda client, robot: [_sensor(client, robot, each) for each in children], *rest)


def run_robot_servers(*rest: Any) -> None:
    _run(lambda client, robot: [RobotServer(client, robot).publish], *rest)


def _run(
    make: Callable[[zenoh.Session, int], list[Callable[[], None]]],
    endpoint: str,
    count: int,
    rate_hz: float,
    sessions: int,
) -> None:
    """Lets what publishes for each robot take turns evenly."""
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(session(endpoint)) for _ in range(sessions)]
        publish = [each for i in range(count) for each in make(clients[i % sessions], i)]
        print("ready", flush=True)
        due_s = time.monotonic()
        for each in itertools.cycle(publish):
            each()
            # A robot that cannot keep up sends no burst afterwards.
            due_s = max(due_s + 1 / rate_hz / len(publish), time.monotonic() - 1)
            time.sleep(max(0.0, due_s - time.monotonic()))


def _sensor(client: zenoh.Session, robot: int, child: NDArray[np.int64]) -> Callable[[], None]:
    """Publishes some frames of a robot: a chain of four links below the map, and all other frames
    on its end."""
    key = keys.put("main", f"robot{robot}/sensor{child[0]}", static=False)
    block = zenoh.CongestionControl.BLOCK
    publisher = client.declare_publisher(key, congestion_control=block)
    frames = ["map", *(f"robot{robot}/frame{i}" for i in range(FRAMES))]
    parent = np.where(child <= 4, child - 1, 4)
    used = np.union1d(parent, child)
    places = [np.searchsorted(used, ids).astype(np.uint32) for ids in (parent, child)]
    stamps = np.full(len(child), _CLOCK_NS)
    poses = np.tile([1.0, 0, 0, 0, 0, 0, 1], (len(child), 1))
    rows = TransformRows([frames[at] for at in used], places[0], places[1], stamps, poses)
    # Packed once: that of thousands of messages a second would take a core from the server.
    message = bytearray(wire.pack(wire.commit_body(wire.Commit(rows))))
    begin = message.index(stamps.tobytes())
    place = slice(begin, begin + stamps.nbytes)

    def publish() -> None:
        message[place] = time.monotonic_ns().to_bytes(8, "little") * len(stamps)
        publisher.put(bytes(message))

    return publish


class RobotServer:
    """Serves a chain of frames below the map: answers `hello`, and `snapshot` with the whole of an
    interest in its frames; then publishes the interest's stream, with the time of the message as
    the stamp."""

    def __init__(self, client: zenoh.Session, number: int) -> None:
        self._session = client
        self._instance = f"instance{number}"
        self._seq = 1 << 40  # of the last commit; all have the same length in a message
        self._publisher: zenoh.Publisher | None = None
        self._tree = f"robots/r{number}"
        for request_type, answer in (("hello", self._hello), ("snapshot", self._snapshot)):
            client.declare_queryable(keys.request(self._tree, request_type), answer)
        # Packed once, as a sensor's.
        changes = _changes(_CLOCK_NS, _SEQ)
        message = stream.StreamMessage(self._instance, _SEQ, _SEQ, _CLOCK_NS, changes)
        self._message = wire.pack(stream.stream_body(message))
        self._token = client.liveliness().declare_token(keys.server(self._tree, self._instance))

    def publish(self) -> None:
        if self._publisher is not None:
            self._seq += 1
            message = self._message
            sent = _bytes(self._seq, time.monotonic_ns())
            for placeholder, value in zip(_PLACEHOLDERS, sent, strict=True):
                message = message.replace(placeholder, value)
            self._publisher.put(message)

    def _hello(self, query: zenoh.Query) -> None:
        value = {"clock_ns": time.monotonic_ns(), "seq": self._seq}
        self._reply(query, {"value": value})

    def _snapshot(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        interest = wire.parse_interest(wire.unpack(query.payload.to_bytes()))
        assert interest is not None
        self._seq += 1
        clock_ns = time.monotonic_ns()
        changes, bounds = _changes(clock_ns, self._seq), stream.NO_BOUNDS
        plan = stream.SnapshotPlan(self._seq, False, bounds, _SETTINGS, clock_ns, changes)
        self._reply(query, stream.snapshot_plan_reply(plan))
        key = keys.stream(self._tree, self._instance, interest.id)
        self._publisher = self._publisher or self._session.declare_publisher(key)

    def _reply(self, query: zenoh.Query, fields: wire.Message) -> None:
        body = {"v": wire.VERSION, "instance": self._instance, **fields}
        query.reply(query.key_expr, wire.pack(body))


def _changes(stamp_ns: int, seq: int) -> bytes:
    """A sample of each frame that is served."""
    rows = len(SERVED)
    child = np.arange(1, rows + 1, dtype=np.uint32)
    version = np.full(rows, 2 * seq, np.uint64)
    pose = np.tile([1.0, 0, 0, 0, 0, 0, 1], (rows, 1))
    return wire.pack(
        {
            "names": ["map", *SERVED],
            "authorities": ["wheels"],
            "kind": bytes(rows),
            "frame": child.tobytes(),
            "version": version.tobytes(),
            "parent": (child - 1).tobytes(),
            "authority": bytes(4 * rows),
            "stamp": np.full(rows, stamp_ns, np.int64).tobytes(),
            "pose": pose.tobytes(),
            "lost": b"",
        }
    )


def _bytes(seq: int, clock_ns: int) -> tuple[bytes, ...]:
    """How a number and a time stand in a message: as such, in the versions and in the stamps."""
    fields = seq.to_bytes(8, "big"), clock_ns.to_bytes(8, "big")
    return *fields, (2 * seq).to_bytes(8, "little"), clock_ns.to_bytes(8, "little")


_PLACEHOLDERS = _bytes(_SEQ, _CLOCK_NS)
