"""Robots that publish: ``python -m bench.parts.robots ENDPOINT ROBOTS MESSAGES``. Each puts its
frames in so many messages, with the time of the put as the stamp; the robots take turns evenly."""

from __future__ import annotations

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


def robots(endpoint: str, count: int, messages: int = 1) -> Process:
    """The robots as a process; each sends `messages` messages with 60 frames in all at 100 Hz."""
    return Process.of(__name__, endpoint, count, messages)


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
        self._names = [frames[place] for place in used]
        self._parent, self._child = (
            np.searchsorted(used, ids).astype(np.uint32) for ids in (parent, child)
        )
        self._poses = np.tile([1.0, 0, 0, 0, 0, 0, 1], (len(child), 1))

    def publish(self) -> None:
        stamps = np.full(len(self._poses), time.monotonic_ns())
        rows = TransformRows(self._names, self._parent, self._child, stamps, self._poses)
        self._publisher.put(wire.pack(wire.commit_body(wire.Commit(rows))))


def main() -> None:
    endpoint, count, messages = sys.argv[1], *map(int, sys.argv[2:])
    with session(endpoint) as client:
        children = np.array_split(np.arange(1, FRAMES + 1), messages)
        sensors = [Sensor(client, robot, child) for robot in range(count) for child in children]
        print("ready", flush=True)
        due_s = time.monotonic()
        while True:
            for sensor in sensors:
                sensor.publish()
                # A robot that cannot keep up sends no burst afterwards.
                due_s = max(due_s + 1 / RATE_HZ / len(sensors), time.monotonic() - 1)
                time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
