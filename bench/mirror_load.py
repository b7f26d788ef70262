"""Robots that publish: ``python -m bench.mirror_load ENDPOINT ROBOTS``. Each puts all of its frames
in one message, with the time of the put as the stamp; the robots take turns evenly."""

from __future__ import annotations

import sys
import time

import numpy as np
import zenoh

from bench.remote import connect
from zenoh_tf import keys, wire

FRAMES = 60
RATE_HZ = 100


def messages(robot: int) -> tuple[list[str], wire.Commit]:
    """A chain of four links below the map, and all other frames on its end."""
    names = ["map", *(f"robot{robot}/frame{i}" for i in range(FRAMES))]
    child = np.arange(1, FRAMES + 1, dtype=np.uint32)
    parent = np.where(child <= 4, child - 1, 4).astype(np.uint32)
    pose = np.tile([1.0, 0, 0, 0, 0, 0, 1], (FRAMES, 1))
    stamp = np.zeros(FRAMES, np.int64)
    return names, wire.Commit(names, parent, child, stamp, pose)


def main() -> None:
    endpoint, robots = sys.argv[1], int(sys.argv[2])
    with connect(endpoint) as session:
        publishers = [
            session.declare_publisher(
                keys.put("main", f"robot{robot}", static=False),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
            for robot in range(robots)
        ]
        commits = [messages(robot)[1] for robot in range(robots)]
        print("ready", flush=True)
        period_s = 1 / RATE_HZ / robots
        due_s = time.monotonic()
        while True:
            for publisher, commit in zip(publishers, commits, strict=True):
                commit.stamp[:] = time.monotonic_ns()
                publisher.put(wire.pack(wire.commit_body(commit)))
                due_s += period_s
                pause_s = due_s - time.monotonic()
                if pause_s > 0:
                    time.sleep(pause_s)
                elif pause_s < -1:  # it cannot keep up: no burst afterwards
                    due_s = time.monotonic()


if __name__ == "__main__":
    main()
