"""One sensor as a process: ``python -m demo_robot.sensors NAME --connect ENDPOINT``.

Publishes until SIGTERM or SIGINT, then prints one JSON line: what it sent in how much time.
"""

from __future__ import annotations

import argparse
import json
import signal
import threading
import time
from collections.abc import Callable, Sequence

from demo_robot import motion
from zenoh_tf import StampedTransform
from zenoh_tf_client import TransformClient

Measure = Callable[[int], Sequence[StampedTransform]]


def _localisation(now: int) -> list[StampedTransform]:
    return [StampedTransform("map", "odom", now, motion.X_map_odom(now))]


def _wheels(now: int) -> list[StampedTransform]:
    return [StampedTransform("odom", "base_link", now, motion.X_odom_base(now))]


def _arm(now: int) -> list[StampedTransform]:
    return [StampedTransform(parent, child, now, X) for parent, child, X in motion.arm(now)]


def _camera(now: int) -> list[StampedTransform]:
    return [StampedTransform("camera", "object", now, motion.X_camera_object(now))]


#: name -> (rate in Hz, measurement, static links)
SENSORS: dict[str, tuple[float, Measure, list[StampedTransform]]] = {
    "localisation": (10.0, _localisation, []),
    "wheels": (50.0, _wheels, []),
    "arm": (200.0, _arm, []),
    "camera": (
        15.0,
        _camera,
        [StampedTransform("base_link", "camera", 0, motion.X_base_camera)],
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=SENSORS)
    parser.add_argument("--connect", required=True)
    args = parser.parse_args()
    rate_hz, measure, static = SENSORS[args.name]

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())

    sent = 0
    with TransformClient.connect(args.connect) as tf:
        broadcaster = tf.broadcaster(args.name)
        if static:
            broadcaster.send_static(static)
        start = due = time.monotonic()
        while not stop.wait(max(0.0, due - time.monotonic())):
            broadcaster.send(measure(time.time_ns()))
            sent += 1
            due += 1 / rate_hz
        spent_s = time.monotonic() - start
    print(json.dumps({"asked_hz": rate_hz, "sent": sent, "spent_s": spent_s}), flush=True)


if __name__ == "__main__":
    main()
