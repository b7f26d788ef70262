"""A transform tree with a Python API, timed on request: zenoh-tf, or the real tf2.

``zenoh-tf`` or ``tf2`` is the argument; each runs under the interpreter that has it. One JSON
object a line: ``{"statement": CODE, "calls": N}`` is answered with seconds, and ``{"ask": STAMP_NS
or null}`` with the pose. A statement that uses ``built`` finds its transforms ready-made.
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
        "ask": lambda at_ns: tree.lookup_transform(TARGET, SOURCE, at_ns).transform.pose(),
    }


def tf2() -> dict[str, Any]:
    tf2_py, messages = import_module("tf2_py"), import_module("geometry_msgs.msg")
    time = import_module("genpy").Time
    buffer = tf2_py.BufferCore(import_module("genpy").Duration(workload.CACHE_S))

    def moment(stamp_ns: int | None) -> Any:
        return time(*divmod(stamp_ns or 0, 1_000_000_000))

    def make(row: Row) -> Any:
        m = messages.TransformStamped()
        m.header.frame_id, m.child_frame_id, m.header.stamp = row[0], row[1], moment(row[2])
        t, q = m.transform.translation, m.transform.rotation
        t.x, t.y, t.z = row[3]
        q.x, q.y, q.z, q.w = row[4]
        return m

    def ask(at_ns: int | None) -> list[float]:
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
    names = {"zenoh-tf": zenoh_tf, "tf2": tf2}[sys.argv[1]]()
    later_ns, pose = workload.later_ns(), workload.pose(0, 0)
    names |= {"TARGET": TARGET, "SOURCE": SOURCE}
    names["build"] = lambda: names["make"]((TARGET, SET_FRAME, next(later_ns), *pose))
    print("ready", flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        if "ask" in asked:
            print(json.dumps(list(names["ask"](asked["ask"]))), flush=True)
        else:
            code, calls = asked["statement"], asked["calls"]
            ready = calls if "built" in code else 0
            names["built"] = iter([names["build"]() for _ in range(ready)])
            print(timeit.timeit(code, number=calls, globals=names), flush=True)
