"""A transform tree with a Python API: zenoh-tf, or the real tf2; under the interpreter that has it.

``SYSTEM`` reads lines: ``CALLS STATEMENT`` is answered with the microseconds of a call, and ``0``
with the poses that answer some lookups, as JSON.
"""

from __future__ import annotations

import itertools
import json
import math
import random
import sys
import timeit
from collections.abc import Iterator
from importlib import import_module
from typing import Any

FRAMES = ["map", "odom", "base_link", "arm", "camera"]
TARGET, SOURCE = FRAMES[0], FRAMES[-1]
#: The frame of single sets, a child of the target.
SET_FRAME = "set_here"
CACHE_S = 10
PERIOD_NS = 10_000_000
SAMPLES = CACHE_S * 1_000_000_000 // PERIOD_NS
#: Soon after the epoch: tf2's Python binding passes times as float64 seconds, exact only there.
START_NS = 1_000_000_000_000
END_NS = START_NS + (SAMPLES - 1) * PERIOD_NS
#: Stamps of samples that follow the history.
LATER_NS = itertools.count(END_NS + PERIOD_NS, PERIOD_NS)
#: Lookups of one bulk call.
ROWS = 1000
#: Random times between the first sample and the last, for as many lookups.
TIMES_NS = random.Random(42).sample(range(START_NS, END_NS), ROWS)

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: parent, child, stamp_ns, translation, rotation (x, y, z, w)
Row = tuple[str, str, int, Vector, Quaternion]


def pose(link: int, sample: int) -> tuple[Vector, Quaternion]:
    """No rotation is the identity, none is around one axis."""
    half = (0.3 + 0.1 * link + 0.002 * sample) / 2
    axis = [2 / 7, 3 / 7, 6 / 7]
    x, y, z = (axis[(link + i) % 3] * math.sin(half) for i in range(3))
    return (0.5 + 0.25 * link, -1 + 0.001 * sample, 0.125 * link), (x, y, z, math.cos(half))


def history() -> Iterator[Row]:
    """Ten seconds at 100 Hz of a chain of depth 4, and of the frame that is set."""
    for sample in range(SAMPLES):
        stamp_ns = START_NS + sample * PERIOD_NS
        for link, (parent, child) in enumerate(itertools.pairwise(FRAMES)):
            yield parent, child, stamp_ns, *pose(link, sample)
        yield TARGET, SET_FRAME, stamp_ns, *pose(len(FRAMES), sample)


def zenoh_tf() -> dict[str, Any]:
    api, numpy = import_module("zenoh_tf"), import_module("numpy")
    tree = api.TransformTree(cache_time_s=CACHE_S)

    def make(row: Row) -> Any:
        return api.StampedTransform(*row[:3], api.Transform(*row[3:]))

    for row in history():
        tree.set_transform(make(row))
    lookup = tree.lookup_transform
    return {
        "tree": tree,
        "targets": [TARGET] * ROWS,
        "sources": [SOURCE] * ROWS,
        "times": itertools.cycle(TIMES_NS),
        "times_array": numpy.array(TIMES_NS),
        "make": make,
        "ask": lambda at_ns: list(lookup(TARGET, SOURCE, at_ns or None).transform.pose()),
    }


def tf2() -> dict[str, Any]:
    tf2_py, messages = import_module("tf2_py"), import_module("geometry_msgs.msg")
    time = import_module("genpy").Time
    buffer = tf2_py.BufferCore(import_module("genpy").Duration(CACHE_S))

    def moment(stamp_ns: int) -> Any:
        return time(*divmod(stamp_ns, 1_000_000_000))

    def make(row: Row) -> Any:
        m = messages.TransformStamped()
        m.header.frame_id, m.child_frame_id, m.header.stamp = row[0], row[1], moment(row[2])
        t, q = m.transform.translation, m.transform.rotation
        t.x, t.y, t.z = row[3]
        q.x, q.y, q.z, q.w = row[4]
        return m

    def ask(at_ns: int) -> list[float]:
        transform = buffer.lookup_transform_core(TARGET, SOURCE, moment(at_ns)).transform
        t, q = transform.translation, transform.rotation
        return [t.x, t.y, t.z, q.x, q.y, q.z, q.w]

    for row in history():
        buffer.set_transform(make(row), "bench")
    times = itertools.cycle([moment(at_ns) for at_ns in TIMES_NS])
    lookup = buffer.lookup_transform_core
    names = {"lookup": lookup, "store": buffer.set_transform, "latest": time(), "times": times}
    return names | {"make": make, "ask": ask}


def main() -> None:
    system = sys.argv[1]
    names = {"zenoh-tf": zenoh_tf, "tf2": tf2}[system]() | {"TARGET": TARGET, "SOURCE": SOURCE}
    make, set_pose = names["make"], pose(0, 0)
    names["build"] = lambda: make((TARGET, SET_FRAME, next(LATER_NS), *set_pose))
    print("ready", flush=True)
    for line in sys.stdin:
        calls, _, statement = line.partition(" ")
        if int(calls):
            seconds = timeit.timeit(statement, number=int(calls), globals=names)
            print(1e6 * seconds / int(calls), flush=True)
        else:
            print(json.dumps([names["ask"](at_ns) for at_ns in (0, *TIMES_NS[:100])]), flush=True)


if __name__ == "__main__":
    main()
