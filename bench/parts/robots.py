"""Robots that publish: ``python -m bench.parts.robots ENDPOINT ROBOTS MESSAGES RATE_HZ SESSIONS``.
Each puts its frames in so many messages, with the time of the put as the stamp; the robots take
turns evenly, and share so many sessions."""

from __future__ import annotations

import contextlib
import sys
import time

import numpy as np
import zenoh
from numpy.typing import NDArray

from bench.process import Process
from bench.server import session
from zenoh_tf import wire
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys

FRAMES, RATE_HZ = 60, 100
#: Stands for the stamps until a message is sent.
_STAMP_NS = 0x0102030405060708


def robots(
    endpoint: str, count: int, messages: int = 1, rate_hz: float = RATE_HZ, sessions: int = 1
) -> Process:
    """The robots as a process; each sends `messages` messages with 60 frames in all at a rate."""
    return Process.of(__name__, endpoint, count, messages, rate_hz, sessions)


class Sensor:
    """Publishes some frames of a robot: a chain of four links below the map, and all other frames
    on its end."""

    def __init__(self, client: zenoh.Session, robot: int, child: NDArray[np.int64]) -> None:
        key = keys.put("main", f"robot{robot}/sensor{child[0]}", static=False)
        block = zenoh.CongestionControl.BLOCK
        self._publisher = client.declare_publisher(key, congestion_control=block)
        frames = ["map", *(f"robot{robot}/frame{i}" for i in range(FRAMES))]
        parent = np.where(child <= 4, child - 1, 4)
        used = np.union1d(parent, child)
        places = [np.searchsorted(used, ids).astype(np.uint32) for ids in (parent, child)]
        stamps = np.full(len(child), _STAMP_NS)
        poses = np.tile([1.0, 0, 0, 0, 0, 0, 1], (len(child), 1))
        rows = TransformRows([frames[at] for at in used], places[0], places[1], stamps, poses)
        # Packed once: that of thousands of messages a second would take a core from the server.
        self._message = bytearray(wire.pack(wire.commit_body(wire.Commit(rows))))
        begin = self._message.index(stamps.tobytes())
        self._stamps, self._rows = slice(begin, begin + stamps.nbytes), len(stamps)

    def publish(self) -> None:
        self._message[self._stamps] = time.monotonic_ns().to_bytes(8, "little") * self._rows
        self._publisher.put(bytes(self._message))


def main() -> None:
    endpoint, count, messages, rate_hz, sessions = sys.argv[1], *map(float, sys.argv[2:])
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(session(endpoint)) for _ in range(int(sessions))]
        children = np.array_split(np.arange(1, FRAMES + 1), int(messages))
        sensors = [
            Sensor(clients[robot % len(clients)], robot, child)
            for robot in range(int(count))
            for child in children
        ]
        print("ready", flush=True)
        due_s = time.monotonic()
        while True:
            for sensor in sensors:
                sensor.publish()
                # A robot that cannot keep up sends no burst afterwards.
                due_s = max(due_s + 1 / rate_hz / len(sensors), time.monotonic() - 1)
                time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
