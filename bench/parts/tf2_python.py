"""tf2's own Python binding, for the interpreter that has it: ``CALLS STATEMENT`` is answered with
the microseconds of a call, ``0`` with the poses of some lookups."""

from __future__ import annotations

import itertools
from importlib import import_module
from typing import Any

from bench.parts.chain import CACHE_S, SOURCE, TARGET, TIMES_NS, Row, history, next_row, us_per_call
from bench.process import serve

tf2_py, messages, genpy = map(import_module, ("tf2_py", "geometry_msgs.msg", "genpy"))
BUFFER = tf2_py.BufferCore(genpy.Duration(CACHE_S))


def moment(stamp_ns: int) -> Any:
    return genpy.Time(*divmod(stamp_ns, 1_000_000_000))


def make(row: Row) -> Any:
    m = messages.TransformStamped()
    m.header.frame_id, m.child_frame_id, m.header.stamp = row[0], row[1], moment(row[2])
    t, q = m.transform.translation, m.transform.rotation
    t.x, t.y, t.z = row[3]
    q.x, q.y, q.z, q.w = row[4]
    return m


def pose(at_ns: int) -> list[float]:
    transform = BUFFER.lookup_transform_core(TARGET, SOURCE, moment(at_ns)).transform
    t, q = transform.translation, transform.rotation
    return [t.x, t.y, t.z, q.x, q.y, q.z, q.w]


NAMES = {
    "TARGET": TARGET,
    "SOURCE": SOURCE,
    "lookup": BUFFER.lookup_transform_core,
    "store": BUFFER.set_transform,
    "latest": genpy.Time(),
    "times": itertools.cycle([moment(at_ns) for at_ns in TIMES_NS]),
    "build": lambda: make(next_row()),
}


def answer(line: str) -> float | list[list[float]]:
    calls, _, statement = line.partition(" ")
    if int(calls):
        return us_per_call(statement, int(calls), NAMES)
    return [pose(at_ns) for at_ns in (0, *TIMES_NS[:100])]


if __name__ == "__main__":
    for each in history():
        BUFFER.set_transform(make(each), "bench")
    serve(answer)
