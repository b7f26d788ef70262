"""Robots that publish: ``python -m bench.robots ENDPOINT ROBOTS MESSAGES``. Each puts its frames in
so many messages, with the time of the put as the stamp; the robots take turns evenly."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import zenoh

from bench.process import Process, connect, module
from zenoh_tf import wire
from zenoh_tf._core import TransformRows
from zenoh_tf._net import keys

FRAMES = 60
RATE_HZ = 100


def robots(endpoint: str, count: int, messages: int = 1) -> Process:
    """The robots as a process; each sends `messages` messages with 60 frames in all at 100 Hz."""
    return module("bench.robots", endpoint, str(count), str(messages))


def chains(robot: int, count: int) -> Iterator[tuple[Any, ...]]:
    """A chain of four links below the map, and all other frames on its end: the names, parents,
    children and poses of each of `count` messages."""
    frames = ["map", *(f"robot{robot}/frame{i}" for i in range(FRAMES))]
    for child in np.array_split(np.arange(1, FRAMES + 1), count):
        parent = np.where(child <= 4, child - 1, 4)
        used = np.union1d(parent, child)
        ups, downs = (np.searchsorted(used, ids).astype(np.uint32) for ids in (parent, child))
        pose = np.tile([1.0, 0, 0, 0, 0, 0, 1], (len(child), 1))
        names = [frames[place] for place in used]
        yield names, ups, downs, pose


def main() -> None:
    endpoint, count, messages = sys.argv[1], *map(int, sys.argv[2:])
    with connect(endpoint) as session:
        sources = [
            (
                session.declare_publisher(
                    keys.put("main", f"robot{robot}/sensor{sensor}", static=False),
                    congestion_control=zenoh.CongestionControl.BLOCK,
                ),
                chain,
            )
            for robot in range(count)
            for sensor, chain in enumerate(chains(robot, messages))
        ]
        print("ready", flush=True)
        period_s = 1 / RATE_HZ / len(sources)
        due_s = time.monotonic()
        while True:
            for publisher, (names, parent, child, pose) in sources:
                stamps = np.full(len(child), time.monotonic_ns())
                rows = TransformRows(names, parent, child, stamps, pose)
                publisher.put(wire.pack(wire.commit_body(wire.Commit(rows))))
                due_s += period_s
                pause_s = due_s - time.monotonic()
                if pause_s > 0:
                    time.sleep(pause_s)
                elif pause_s < -1:  # it cannot keep up: no burst afterwards
                    due_s = time.monotonic()


if __name__ == "__main__":
    main()
