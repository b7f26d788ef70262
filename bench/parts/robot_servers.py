"""Emulated servers of robots for a site to follow: ``python -m bench.parts.robot_servers ENDPOINT
ROBOTS RATE_HZ SESSIONS``.

Each has a tree ``robots/rN`` on the site's network, answers `hello`, and answers `snapshot` with
the whole of an interest in its FRAMES; then it publishes the interest's stream, with the time of
the message as the stamp. The robots take turns evenly, and share so many sessions."""

from __future__ import annotations

import contextlib
import sys
import time

import numpy as np
import zenoh

from bench.process import Process
from bench.server import session
from zenoh_tf import wire
from zenoh_tf._net import keys
from zenoh_tf.wire import stream

FRAMES = ("base", "arm", "camera")
_NAMES = ["map", *FRAMES]
_ROWS = len(FRAMES)
_SETTINGS = stream.TreeSettings(10**10, 100, 1000, 255, 1000)
#: The first number of a commit. All have the same length in a message.
_FIRST_SEQ = 1 << 40
#: Stand for the number and the time of a message until it is sent.
_SEQ, _CLOCK_NS = 0x0102030405060708, 0x1112131415161718


def _bytes(seq: int, clock_ns: int) -> tuple[bytes, ...]:
    """How a number and a time stand in a message: as such, in the versions and in the stamps."""
    fields = seq.to_bytes(8, "big"), clock_ns.to_bytes(8, "big")
    return *fields, (2 * seq).to_bytes(8, "little"), clock_ns.to_bytes(8, "little")


_PLACEHOLDERS = _bytes(_SEQ, _CLOCK_NS)


def robot_servers(endpoint: str, count: int, rate_hz: float, sessions: int) -> Process:
    """The servers as a process."""
    return Process.of(__name__, endpoint, count, rate_hz, sessions)


class RobotServer:
    """Serves a chain of frames below the map."""

    def __init__(self, client: zenoh.Session, number: int) -> None:
        self._session = client
        self._instance = f"instance{number}"
        self._seq = _FIRST_SEQ
        self._publisher: zenoh.Publisher | None = None
        self._tree = f"robots/r{number}"
        answers = {"hello": self._hello, "snapshot": self._snapshot}
        for request_type, answer in answers.items():
            client.declare_queryable(keys.request(self._tree, request_type), answer)
        # Packed once: that of thousands of messages a second would take a core from the site.
        changes = self._changes(_CLOCK_NS, _SEQ)
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

    def _changes(self, stamp_ns: int, seq: int) -> stream.Changes:
        """A sample of each frame."""
        child = np.arange(1, _ROWS + 1, dtype=np.uint32)
        version = np.full(_ROWS, 2 * seq, np.uint64)
        pose = np.tile([1.0, 0, 0, 0, 0, 0, 1], (_ROWS, 1))
        kind, authority = np.zeros(_ROWS, np.uint8), np.zeros(_ROWS, np.uint32)
        stamps = np.full(_ROWS, stamp_ns)
        lost = np.zeros(0, np.uint32)
        parent = child - 1
        return _NAMES, ["wheels"], kind, child, version, parent, authority, stamps, pose, lost

    def _hello(self, query: zenoh.Query) -> None:
        value = {"clock_ns": time.monotonic_ns(), "seq": self._seq}
        self._reply(query, {"value": value})

    def _snapshot(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        interest = wire.parse_interest(wire.unpack(query.payload.to_bytes()))
        assert interest is not None
        self._seq += 1
        clock_ns = time.monotonic_ns()
        changes, bounds = self._changes(clock_ns, self._seq), stream.NO_BOUNDS
        plan = stream.SnapshotPlan(self._seq, False, bounds, _SETTINGS, clock_ns, changes)
        self._reply(query, stream.snapshot_plan_reply(plan))
        key = keys.stream(self._tree, self._instance, interest.id)
        self._publisher = self._publisher or self._session.declare_publisher(key)

    def _reply(self, query: zenoh.Query, fields: wire.Message) -> None:
        body = {"v": wire.VERSION, "instance": self._instance, **fields}
        query.reply(query.key_expr, wire.pack(body))


def main() -> None:
    endpoint, count, rate_hz, sessions = sys.argv[1], *map(float, sys.argv[2:])
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(session(endpoint)) for _ in range(int(sessions))]
        robots = [RobotServer(clients[i % len(clients)], i) for i in range(int(count))]
        print("ready", flush=True)
        due_s = time.monotonic()
        while True:
            for robot in robots:
                robot.publish()
                # One that cannot keep up sends no burst afterwards.
                due_s = max(due_s + 1 / rate_hz / len(robots), time.monotonic() - 1)
                time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
