"""tf2's own Python binding, timed on request. Runs under the interpreter that has it.

One JSON object a line: ``{"case": NAME, "calls": N}`` is answered with seconds, and
``{"ask": STAMP_NS or null}`` with the pose.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

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


class Cases:
    def __init__(self) -> None:
        self.buffer = tf2_py.BufferCore(genpy.Duration(workload.CACHE_S))
        for row in workload.history():
            self.buffer.set_transform(message(row), "bench")
        self.times = [moment(stamp_ns) for stamp_ns in workload.times_ns()]
        self.sample = workload.SAMPLES

    def lookup_common(self, calls: int) -> float:
        lookup, latest = self.buffer.lookup_transform_core, genpy.Time()
        start = time.perf_counter()
        for _ in range(calls):
            lookup(TARGET, SOURCE, latest)
        return time.perf_counter() - start

    def lookup_at(self, calls: int) -> float:
        lookup, times = self.buffer.lookup_transform_core, self.times
        start = time.perf_counter()
        for i in range(calls):
            lookup(TARGET, SOURCE, times[i % workload.ROWS])
        return time.perf_counter() - start

    def set_built(self, calls: int) -> float:
        pose = workload.pose(0, 0)
        messages = [message((TARGET, SET_FRAME, at_ns, *pose)) for at_ns in self._next(calls)]
        store = self.buffer.set_transform
        start = time.perf_counter()
        for m in messages:
            store(m, "bench")
        return time.perf_counter() - start

    def build_and_set(self, calls: int) -> float:
        pose = workload.pose(0, 0)
        stamps_ns = self._next(calls)
        store = self.buffer.set_transform
        start = time.perf_counter()
        for stamp_ns in stamps_ns:
            store(message((TARGET, SET_FRAME, stamp_ns, *pose)), "bench")
        return time.perf_counter() - start

    def ask(self, stamp_ns: int | None) -> list[float]:
        at = genpy.Time() if stamp_ns is None else moment(stamp_ns)
        transform = self.buffer.lookup_transform_core(TARGET, SOURCE, at).transform
        t, q = transform.translation, transform.rotation
        return [t.x, t.y, t.z, q.x, q.y, q.z, q.w]

    def _next(self, count: int) -> list[int]:
        first, self.sample = self.sample, self.sample + count
        return [workload.START_NS + i * workload.PERIOD_NS for i in range(first, first + count)]


def main() -> None:
    cases = Cases()
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        if "ask" in request:
            reply: object = cases.ask(request["ask"])
        else:
            run: Callable[[int], float] = getattr(cases, request["case"])
            reply = run(request["calls"])
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main()
