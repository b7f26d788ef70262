"""``python probe.py ENDPOINT KIND PERIOD_S``: calls the service at a steady rate until stdin ends.

Prints each call as [start, end, outcome, age of the newest data]. Uses the SDK's public interface
only, and nothing of the tests, so that it runs with the SDK of another checkout.
"""

from __future__ import annotations

import functools
import json
import sys
import threading
import time
from collections.abc import Callable

from zenoh_tf import StampedTransform, Transform, TransformException
from zenoh_tf_client import TransformClient

client_of = functools.partial(TransformClient.connect, reads="query")


def main() -> None:
    endpoint, kind, period = sys.argv[1:]
    tf = client_of(endpoint, timeout_s=20.0)
    tf.set_transform(StampedTransform("probe_map", "probe_base", 1, Transform()), static=True)
    call = action(tf, kind)
    call()
    stop = threading.Event()

    def listen() -> None:
        sys.stdin.read()
        stop.set()

    threading.Thread(target=listen, daemon=True).start()
    print("ready", flush=True)
    calls = []
    next_s = time.monotonic()
    while not stop.is_set():
        start_s = time.monotonic()
        outcome, age_s = "ok", 0.0
        try:
            age_s = call()
        except TransformException as error:
            outcome = type(error).__name__
        calls.append((start_s, time.monotonic(), outcome, age_s))
        # An open loop after a stall would only repeat the stall's delay: the rate starts again.
        next_s = max(next_s + float(period), time.monotonic())
        stop.wait(max(0.0, next_s - time.monotonic()))
    for entry in calls:
        print(json.dumps(entry))
    sys.stdout.flush()


def action(tf: TransformClient, kind: str) -> Callable[[], float]:
    count = iter(range(1, 1 << 62))

    def lookup() -> float:
        tf.lookup_latest_transform("probe_map", "probe_base")
        return 0.0

    def write() -> float:
        tf.set_transform(StampedTransform("probe_map", "probe_set", next(count), Transform()))
        return 0.0

    def new_frame() -> float:
        name = f"probe_new_{next(count)}"
        tf.set_transform(StampedTransform("probe_map", name, 1, Transform()))
        return 0.0

    def info() -> float:
        tf.stats()
        return 0.0

    sensor = tf.broadcaster("probe_sensor")

    def data() -> float:
        """The age of the newest data, behind what was just sent."""
        sensor.send(StampedTransform("probe_map", "probe_data", time.time_ns(), Transform()))
        try:
            newest_ns = tf.lookup_transform("probe_map", "probe_data").stamp_ns
        except TransformException:
            return 0.0
        return (time.time_ns() - newest_ns) / 1e9

    return {"lookup": lookup, "set": write, "new": new_frame, "info": info, "sensor": data}[kind]


if __name__ == "__main__":
    main()
