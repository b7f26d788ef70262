"""All robots of a site share one thread, and none holds another one up."""

from __future__ import annotations

import functools
from pathlib import Path

from tests.conftest import StartServer
from tests.processes.ports import free_endpoint
from tests.support.waiting import wait_until
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient


def has(tf: TransformClient, names: set[str]) -> bool:
    return set(tf.frames()) == names


def test_robots_cost_no_threads(start_server: StartServer) -> None:
    server = start_server()
    with server.connect() as robot:
        robot.set_transform(StampedTransform("map", "base", 1, Transform()))
    counts = []
    for robots in (1, 12):
        links = [f"--mirror-of=r{number}={server.endpoint}" for number in range(robots)]
        site = start_server(*links)
        with site.connect() as tf:
            # Each has the two frames of its copy.
            expected = {f"r{number}/{name}" for number in range(robots) for name in ("map", "base")}
            wait_until(functools.partial(has, tf, expected), "all robots")
        counts.append(len(list(Path(f"/proc/{site.process.pid}/task").iterdir())))
    # Zenoh's own threads come and go with its work; eleven feeds had 22 threads of their own.
    assert counts[1] < counts[0] + 20


def test_robots_that_are_away_hold_no_robot_up(start_server: StartServer) -> None:
    """More of them than attempts to connect at once."""
    away = [f"--mirror-of=away{number}={free_endpoint()}" for number in range(12)]
    server = start_server()
    site = start_server(*away, f"--mirror-of=here={server.endpoint},rate=20")
    with server.connect() as robot, site.connect() as tf:
        for stamp in (1, 2, 3):
            robot.set_transform(StampedTransform("map", "base", stamp, Transform((stamp, 0, 0))))

            def has_come(stamp: int = stamp) -> bool:
                frames = tf.frames()
                return "here/base" in frames and tf.frame("here/base").newest_stamp_ns == stamp

            wait_until(has_come, f"sample {stamp}")
        assert tf.stats()["robot_connected/away0"] == 0
