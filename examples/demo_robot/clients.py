"""Remote clients as processes: ``python -m demo_robot.clients ROLE --connect E --seconds S``.

Each prints one JSON line with what it measured, after S seconds or at SIGTERM.
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

from demo_robot import motion
from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

_stopped = threading.Event()

#: The object stays this far in front of the gripper while it is held, in metres.
GRIP_M = 0.1

#: The moving links from map to the wrist, as (parent, child).
LINKS = [
    ("map", "odom"),
    ("odom", "base_link"),
    ("base_link", "shoulder"),
    ("shoulder", "elbow"),
    ("elbow", "wrist"),
]


def watch_staleness(tf: TransformClient, seconds: float) -> dict[str, object]:
    """Look up the wrist in map at the latest common time, and from the newest samples.

    Measures how old each link's data was when asked for, and how far the result was from where the
    wrist truly was at that time.
    """
    ages: dict[str, list[list[float]]] = {"common": [], "latest": []}
    errors: dict[str, list[float]] = {"common": [], "latest": []}
    for _ in _until(seconds, pause_s=0.004):
        asked = time.time_ns()
        common = tf.lookup_transform("map", "wrist")
        # The latest common time is one time for all links.
        ages["common"].append([_ms(asked - common.stamp_ns)] * len(LINKS))
        errors["common"].append(_wrist_error_mm(common, asked))

        asked = time.time_ns()
        # One atomic snapshot of the path and of each link shows which samples the path used.
        latest, *links = tf.lookup_latest_transforms_xact([("map", "wrist"), *LINKS])
        ages["latest"].append([_ms(asked - link.stamp_ns) for link in links])
        errors["latest"].append(_wrist_error_mm(latest, asked))
    return {
        "answers": len(errors["latest"]),
        "links": LINKS,
        "age_ms": {kind: np.median(rows, axis=0).tolist() for kind, rows in ages.items()},
        "mean_age_ms": {
            kind: float(np.median(np.mean(rows, axis=1))) for kind, rows in ages.items()
        },
        "error_mm": {kind: statistics.median(values) for kind, values in errors.items()},
    }


def move_together(tf: TransformClient, seconds: float) -> dict[str, object]:
    """Grasp the object, then lift gripper and object together, each time in one transaction."""
    moves = 0
    start = time.monotonic()
    for _ in _until(seconds):
        lift = 0.2 * (moves % 2)
        now = time.time_ns()
        tf.set_transforms_xact(
            [
                StampedTransform("wrist", "gripper", now, Transform((lift, 0.0, 0.0))),
                StampedTransform("wrist", "object", now, Transform((lift + GRIP_M, 0.0, 0.0))),
            ],
            authority="planner",
        )
        moves += 1
    return {"moves": moves, "spent_s": time.monotonic() - start}


def watch_pairs(tf: TransformClient, seconds: float) -> dict[str, object]:
    """Look up where the object is in the gripper, over and over, by two methods.

    Any result but GRIP_M is torn: the tree never held such a pair.
    """
    lifts: set[float] = set()

    def separately() -> float:
        gripper = tf.lookup_latest_transform("wrist", "gripper").transform
        held = tf.lookup_latest_transform("wrist", "object").transform
        lifts.add(round(float(gripper.translation[0]), 6))
        return float(held.translation[0] - gripper.translation[0])

    def transactionally() -> float:
        return float(tf.lookup_latest_transform_xact("gripper", "object").transform.translation[0])

    methods = {"separate": separately, "transaction": transactionally}
    reads = dict.fromkeys(methods, 0)
    torn = dict.fromkeys(methods, 0)
    while not tf.can_transform("wrist", "gripper"):
        time.sleep(0.01)
    for _ in _until(seconds):
        for method, read in methods.items():
            reads[method] += 1
            torn[method] += abs(read() - GRIP_M) > 1e-9
    return {"reads": reads, "torn": torn, "lifts_seen": sorted(lifts)}


def compare_methods(tf: TransformClient, seconds: float) -> dict[str, object]:
    """Make the same lookup by query, in the server's memory and in a mirror, then a thousand in a
    batch by query."""
    with TransformClient.connect(tf.endpoint, reads="query") as by_query, tf.mirror() as mirror:
        methods = {"query": _measure_lookups(by_query.lookup_latest_transform_xact, seconds / 4)}
        if tf.reads == "shared":
            methods["shared"] = _measure_lookups(tf.lookup_latest_transform_xact, seconds / 4)
        methods["mirror"] = _measure_lookups(mirror.lookup_latest_transform_xact, seconds / 4)
        age_ms = 1e3 * mirror.age_s

        size, batches = 1000, 0
        start_s = time.monotonic()
        for _ in _until(seconds / 4):
            newest_ns = by_query.latest_common_time("map", "wrist") or 0
            stamps_ns = newest_ns - 100_000 * np.arange(size)
            answers = by_query.lookup_transforms("map", "wrist", stamps_ns)
            if np.any(answers.status):
                raise RuntimeError(f"a lookup failed with status {answers.status.max()}")
            batches += 1
        spent_s = time.monotonic() - start_s
    return {
        "methods": methods,
        "mirror_age_ms": age_ms,
        "batch": size,
        "batched_per_s": size * batches / spent_s,
    }


def _measure_lookups(look_up: Callable[[str, str], object], seconds: float) -> dict[str, float]:
    """Look up one after another: the median time, the rate, and the processor time of each."""
    start_ns = time.perf_counter_ns()
    look_up("map", "wrist")
    together = max(1, 200_000 // (time.perf_counter_ns() - start_ns))  # 0.2 ms: fast to measure
    took_us: list[float] = []
    start_s, start_cpu_s = time.monotonic(), time.process_time()
    for _ in _until(seconds):
        start_ns = time.perf_counter_ns()
        for _ in range(together):
            look_up("map", "wrist")
        took_us.append((time.perf_counter_ns() - start_ns) / 1e3 / together)
    spent_s, cpu_s = time.monotonic() - start_s, time.process_time() - start_cpu_s
    count = together * len(took_us)
    return {
        "p50_us": statistics.median(took_us),
        "per_s": count / spent_s,
        "cpu_us": 1e6 * cpu_s / count,
    }


def _until(seconds: float, pause_s: float = 0.0) -> Iterator[None]:
    """Iterate until ``seconds`` have passed, or SIGTERM came."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not _stopped.wait(pause_s):
        yield


def _ms(age_ns: int) -> float:
    return age_ns / 1e6


def _wrist_error_mm(answer: StampedTransform, stamp_ns: int) -> float:
    return error_mm(answer.transform, motion.X_map_wrist(stamp_ns))


def error_mm(answer: Transform, truth: Transform) -> float:
    """Return the distance between two poses' origins."""
    return 1e3 * float(np.linalg.norm(answer.translation - truth.translation))


ROLES: dict[str, Callable[[TransformClient, float], dict[str, object]]] = {
    "staleness": watch_staleness,
    "mover": move_together,
    "reader": watch_pairs,
    "methods": compare_methods,
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("role", choices=ROLES)
    parser.add_argument("--connect", required=True)
    parser.add_argument("--seconds", type=float, required=True)
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: _stopped.set())
    with TransformClient.connect(args.connect) as tf:
        print(json.dumps(ROLES[args.role](tf, args.seconds)), flush=True)


if __name__ == "__main__":
    main()
