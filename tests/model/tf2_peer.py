"""Runs histories on the installed real tf2 (ROS 1), under the interpreter that has it.

Each input line is a history, ``{"cache_ns": N, "calls": [[METHOD, ARGUMENTS], ...]}``. Each output
line is the list of the outcomes of its calls: a pose as ``{"stamp_ns", "pose"}``, an error as
``{"error", "facts"}``, anything else unchanged. Imports nothing of this project.
"""

from __future__ import annotations

import json
import re
import sys
from typing import Any

import genpy  # type: ignore[import-not-found]
import tf2_py  # type: ignore[import-not-found]
from geometry_msgs.msg import TransformStamped

#: tf2 has one class for three errors, and gives facts only in the message.
EXTRAPOLATIONS = [
    ("NoDataForExtrapolationException", "only time", "newest_stamp_ns"),
    ("BackwardExtrapolationException", "earliest data is at time", "oldest_stamp_ns"),
    ("ForwardExtrapolationException", "latest data is at time", "newest_stamp_ns"),
]


def time_of(stamp_ns: int | None) -> genpy.Time:
    """tf2's time 0 asks for the latest common one."""
    return genpy.Time(*divmod(stamp_ns or 0, 1_000_000_000))


def message(row: list[Any]) -> TransformStamped:
    parent, child, stamp_ns, pose = row
    m = TransformStamped()
    m.header.frame_id, m.child_frame_id, m.header.stamp = parent, child, time_of(stamp_ns)
    t, q = m.transform.translation, m.transform.rotation
    t.x, t.y, t.z, q.x, q.y, q.z, q.w = pose
    return m


def answer(found: TransformStamped) -> dict[str, object]:
    t, q = found.transform.translation, found.transform.rotation
    pose = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
    return {"stamp_ns": found.header.stamp.to_nsec(), "pose": pose}


class Peer:
    def __init__(self, cache_ns: int) -> None:
        self.buffer = tf2_py.BufferCore(genpy.Duration(*divmod(cache_ns, 1_000_000_000)))

    def set_transform(self, row: list[Any], authority: str, static: bool) -> None:
        store = self.buffer.set_transform_static if static else self.buffer.set_transform
        store(message(row), authority)

    def clear(self) -> None:
        self.buffer.clear()

    def lookup_transform(self, target: str, source: str, stamp_ns: int | None) -> object:
        return answer(self.buffer.lookup_transform_core(target, source, time_of(stamp_ns)))

    def lookup_transform_full(
        self, target: str, target_ns: int | None, source: str, source_ns: int | None, fixed: str
    ) -> object:
        times = time_of(target_ns), time_of(source_ns)
        return answer(
            self.buffer.lookup_transform_full_core(target, times[0], source, times[1], fixed)
        )

    def can_transform(self, target: str, source: str, stamp_ns: int | None) -> bool:
        return bool(self.buffer.can_transform_core(target, source, time_of(stamp_ns))[0])

    def latest_common_time(self, a: str, b: str) -> object:
        time = self.buffer.get_latest_common_time(a, b)
        return time.to_nsec()

    def frames(self) -> object:
        return self.buffer._getFrameStrings()


def fault(error: Exception) -> dict[str, object]:
    kind, facts, text = type(error).__name__, {}, str(error)
    if kind == "TransformException" and "not part of the same tree" in text:
        kind = "ConnectivityException"  # from its latest_common_time
    for name, words, field in EXTRAPOLATIONS:
        found = re.search(words + r" (\d+\.\d{9})", text)
        asked = re.search(r"(?:Requested time|extrapolation at time) (\d+\.\d{9})", text)
        if found and asked:
            kind = name
            facts = {"stamp_ns": nanoseconds(asked[1]), field: nanoseconds(found[1])}
    return {"error": kind, "facts": facts}


def nanoseconds(decimal: str) -> int:
    return int(decimal.replace(".", ""))


def main() -> None:
    print("ready", flush=True)
    for line in sys.stdin:
        request = json.loads(line)
        peer = Peer(request["cache_ns"])
        replies: list[object] = []
        for method, arguments in request["calls"]:
            try:
                replies.append(getattr(peer, method)(*arguments))
            except tf2_py.TransformException as error:
                replies.append(fault(error))
        print(json.dumps(replies), flush=True)


if __name__ == "__main__":
    main()
