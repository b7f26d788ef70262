"""tf2's own Python binding, timed on request. Runs under the interpreter that has it.

One JSON object a line: ``{"statement": CODE, "calls": N}`` is answered with seconds, and
``{"ask": STAMP_NS or null}`` with the pose.
"""

from __future__ import annotations

import itertools
import json
import sys
import timeit

import genpy  # type: ignore[import-not-found]
import tf2_py  # type: ignore[import-not-found]
from geometry_msgs.msg import TransformStamped  # type: ignore[import-not-found]

from bench import workload
from bench.workload import SET_FRAME, SOURCE, TARGET


def message(row: workload.Row) -> TransformStamped:
    parent, child, stamp_ns, translation, rotation = row
    m = TransformStamped()
    m.header.frame_id, m.child_frame_id, m.header.stamp = parent, child, moment(stamp_ns)
    t, q = m.transform.translation, m.transform.rotation
    t.x, t.y, t.z = translation
    q.x, q.y, q.z, q.w = rotation
    return m


def moment(stamp_ns: int) -> genpy.Time:
    return genpy.Time(*divmod(stamp_ns, 1_000_000_000))


def main() -> None:
    buffer = tf2_py.BufferCore(genpy.Duration(workload.CACHE_S))
    for row in workload.history():
        buffer.set_transform(message(row), "bench")
    later_ns, pose = workload.later_ns(), workload.pose(0, 0)
    names = {
        "lookup": buffer.lookup_transform_core,
        "store": buffer.set_transform,
        "TARGET": TARGET,
        "SOURCE": SOURCE,
        "latest": genpy.Time(),
        "times": itertools.cycle([moment(stamp_ns) for stamp_ns in workload.times_ns()]),
        "build": lambda: message((TARGET, SET_FRAME, next(later_ns), *pose)),
    }
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        if "ask" in request:
            at = genpy.Time() if request["ask"] is None else moment(request["ask"])
            transform = buffer.lookup_transform_core(TARGET, SOURCE, at).transform
            t, q = transform.translation, transform.rotation
            reply: object = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
        else:
            names["built"] = iter([names["build"]() for _ in range(request["build"])])
            reply = timeit.timeit(request["statement"], number=request["calls"], globals=names)
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main()
