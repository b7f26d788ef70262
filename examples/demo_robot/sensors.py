"""One sensor as a process: ``python -m demo_robot.sensors NAME --connect ENDPOINT``.

Publishes until SIGTERM or SIGINT, then prints a JSON line with the number of messages and the rate.
"""

from __future__ import annotations

import argparse
import json
import signal
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from demo_robot import motion
from zenoh_tf import StampedTransform
from zenoh_tf_client import TransformClient


def _localisation(now: int) -> list[StampedTransform]:
    return [StampedTransform("map", "odom", now, motion.X_map_odom(now))]


def _wheels(now: int) -> list[StampedTransform]:
    return [StampedTransform("odom", "base_link", now, motion.X_odom_base(now))]


def _arm(now: int) -> list[StampedTransform]:
    return [StampedTransform(parent, child, now, X) for parent, child, X in motion.arm(now)]


def _camera(now: int) -> list[StampedTransform]:
    return [StampedTransform("camera", "object", now, motion.X_camera_object(now))]


@dataclass(frozen=True)
class Sensor:
    rate_hz: float
    measure: Callable[[int], Sequence[StampedTransform]]
    child_frame: str  # child of the last link that the sensor measures
    static: Sequence[StampedTransform] = ()


SENSORS = {
    "localisation": Sensor(10.0, _localisation, "odom"),
    "wheels": Sensor(50.0, _wheels, "base_link"),
    "arm": Sensor(200.0, _arm, "wrist"),
    "camera": Sensor(
        15.0,
        _camera,
        "object",
        [StampedTransform("base_link", "camera", 0, motion.X_base_camera)],
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=SENSORS)
    parser.add_argument("--connect", required=True)
    args = parser.parse_args()
    sensor = SENSORS[args.name]

    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())

    sent = 0
    with TransformClient.connect(args.connect) as tf:
        broadcaster = tf.broadcaster(args.name)
        if sensor.static:
            broadcaster.send_static(sensor.static)
        start = last = due = time.monotonic()
        while not stop.wait(max(0.0, due - time.monotonic())):
            broadcaster.send(sensor.measure(time.time_ns()))
            last = time.monotonic()
            sent += 1
            due += 1 / sensor.rate_hz
    reached_hz = (sent - 1) / (last - start) if sent > 1 else 0.0
    report = {"asked_hz": sensor.rate_hz, "reached_hz": reached_hz, "sent": sent}
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
