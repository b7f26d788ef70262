"""Calls as values, so that the oracle, the tree and tf2 can run the same history."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from zenoh_tf import (
    ConnectivityException,
    FrameInfo,
    LatestTransform,
    StampedTransform,
    Transform,
    TransformArray,
    TransformException,
    TransformTree,
)

from .oracle import Answer, Oracle, Row

TOLERANCE = 1e-9


class Call(NamedTuple):
    method: str
    arguments: tuple[Any, ...]

    def __str__(self) -> str:
        return f"{self.method}({', '.join(map(repr, self.arguments))})"


class Fault(NamedTuple):
    """An error: its class and those of its fields that the rules determine."""

    kind: str
    facts: dict[str, object]


def ask(tree: TransformTree | Oracle, call: Call) -> object:
    """Run a call and return its outcome in one common form: plain values, answers, faults."""
    arguments = call.arguments
    if isinstance(tree, TransformTree):
        arguments = tuple(_as_stamped(a) for a in arguments)
    try:
        return _plain(getattr(tree, call.method)(*arguments))
    except TransformException as error:
        return _fault(error)


def same(a: object, b: object) -> bool:
    """True if two outcomes are equal; poses within ``TOLERANCE``, quaternions up to sign."""
    if isinstance(a, Answer) and isinstance(b, Answer):
        return a[:2] == b[:2] and _same_pose(a.pose, b.pose)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return type(a) is type(b) and a == b


def _same_pose(a: Sequence[float], b: Sequence[float]) -> bool:
    sign = math.copysign(1.0, sum(x * y for x, y in zip(a[3:], b[3:], strict=True)))
    b = (*b[:3], *(sign * v for v in b[3:]))
    return all(abs(x - y) <= TOLERANCE for x, y in zip(a, b, strict=True))


def _as_stamped(argument: Any) -> Any:
    if isinstance(argument, Row):
        transform = Transform(argument.pose[:3], argument.pose[3:])
        return StampedTransform(argument.parent, argument.child, argument.stamp_ns, transform)
    if isinstance(argument, tuple) and argument and isinstance(argument[0], Row):
        return [_as_stamped(row) for row in argument]
    return argument


def _plain(value: Any) -> object:
    match value:
        case LatestTransform():
            return Answer(value.stamp_ns, value.newest_stamp_ns, value.transform.pose())
        case StampedTransform():
            return Answer(value.stamp_ns, None, value.transform.pose())
        case TransformArray():
            columns = (value.status.tolist(), value.stamps_ns.tolist(), value.poses.tolist())
            return [
                code or Answer(stamp_ns, None, tuple(pose))
                for code, stamp_ns, pose in zip(*columns, strict=True)
            ]
        case FrameInfo():
            fields = ["parent", "static", "samples", "rewritten", "dropped", "reparented"]
            fields += ["switched"]
            if value.samples:
                fields += ["oldest_stamp_ns", "newest_stamp_ns"]
            return {field: getattr(value, field) for field in fields}
        case {"time_jumps": _, "samples": _}:
            return {key: value[key] for key in ("frames", "static_links", "samples", "time_jumps")}
        case list():
            return [_plain(item) for item in value]
    return value


_EXTRAPOLATION = ("frame", "parent_frame", "stamp_ns", "oldest_stamp_ns", "newest_stamp_ns")
_CONNECTIVITY = ("target_root", "source_root", "stamp_ns")


def _fault(error: TransformException) -> Fault:
    fields: tuple[str, ...] = ()
    if error.newest_stamp_ns is not None:
        fields = _EXTRAPOLATION
    elif isinstance(error, ConnectivityException):
        fields = _CONNECTIVITY
    return Fault(type(error).__name__, {field: getattr(error, field, None) for field in fields})
