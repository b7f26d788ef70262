"""A transform tree with a Python API: zenoh-tf, or the real tf2; under the interpreter that has it.

``SYSTEM STATEMENT`` prints the microseconds of a call; ``SYSTEM`` alone prints the poses that
answer some lookups, as JSON.
"""

from __future__ import annotations

import itertools
import json
import sys
import timeit
from importlib import import_module
from typing import Any

from bench import workload
from bench.workload import ROWS, SET_FRAME, SOURCE, TARGET, Row


def zenoh_tf() -> dict[str, Any]:
    api, numpy = import_module("zenoh_tf"), import_module("numpy")
    tree = api.TransformTree(cache_time_s=workload.CACHE_S)

    def make(row: Row) -> Any:
        return api.StampedTransform(*row[:3], api.Transform(*row[3:]))

    for row in workload.history():
        tree.set_transform(make(row))
    times_ns = workload.times_ns()
    return {
        "tree": tree,
        "targets": [TARGET] * ROWS,
        "sources": [SOURCE] * ROWS,
        "times": itertools.cycle(times_ns),
        "times_array": numpy.array(times_ns),
        "make": make,
        "ask": lambda at_ns: list(
            tree.lookup_transform(TARGET, SOURCE, at_ns or None).transform.pose()
        ),
    }


def tf2() -> dict[str, Any]:
    tf2_py, messages = import_module("tf2_py"), import_module("geometry_msgs.msg")
    time = import_module("genpy").Time
    buffer = tf2_py.BufferCore(import_module("genpy").Duration(workload.CACHE_S))

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

    for row in workload.history():
        buffer.set_transform(make(row), "bench")
    times = itertools.cycle([moment(at_ns) for at_ns in workload.times_ns()])
    lookup = buffer.lookup_transform_core
    names = {"lookup": lookup, "store": buffer.set_transform, "latest": time(), "times": times}
    return names | {"make": make, "ask": ask}


if __name__ == "__main__":
    system, *statements = sys.argv[1:]
    names = {"zenoh-tf": zenoh_tf, "tf2": tf2}[system]() | {"TARGET": TARGET, "SOURCE": SOURCE}
    later_ns, pose = workload.later_ns(), workload.pose(0, 0)
    names["build"] = lambda: names["make"]((TARGET, SET_FRAME, next(later_ns), *pose))
    for statement in statements:
        calls, seconds = timeit.Timer(statement, globals=names).autorange()
        print(1e6 * seconds / calls)
    if not statements:
        print(json.dumps([names["ask"](at_ns) for at_ns in (0, *workload.times_ns()[:100])]))
