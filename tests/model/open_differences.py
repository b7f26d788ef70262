"""Where the tree does not yet do what the oracle says, each with the history that shows it.

A predicate here lets a random history go on behind a known fault; the test of the same name in
``test_open_differences.py`` fails as soon as the fault is gone, and then both go too.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from zenoh_tf import LookupException, TransformException

from .calls import Call, Fault, same
from .oracle import Answer, Oracle, Row, Way

NOT_LOOKUP = ("ConnectivityException", "NoDataFor", "Backward", "Forward")


def depth_that_is_just_reached(o: Oracle, call: Call, right: object, given: object) -> bool:
    """A way of exactly ``max_depth`` links that ends there is said to be too deep."""
    if isinstance(right, list) and isinstance(given, list):
        pairs = zip(right, given, strict=True)
        return all(same(r, g) or (r in {3, 7, 8, 9} and g == 2) for r, g in pairs)
    if not (isinstance(right, Fault) and isinstance(given, Fault)):
        return False
    return given.kind == "LookupException" and right.kind.startswith(NOT_LOOKUP)


def two_ways_in_a_past_loop(o: Oracle, call: Call, right: object, given: object) -> bool:
    """Inside a loop of a past time the latest common lookup may go the other way round."""
    return (
        isinstance(right, Answer)
        and isinstance(given, Answer)
        and call.method in {"lookup_transform", "lookup_transform_full"}
        and None in call.arguments
        and right.stamp_ns == given.stamp_ns
        and any(isinstance(way.end, LookupException) for way in _ways_at_common_time(o, call))
    )


def _ways_at_common_time(o: Oracle, call: Call) -> list[Way]:
    frames = [a for a in call.arguments if isinstance(a, str)]
    stamps = []
    for a, b in [(frames[0], frames[-1]), (frames[-1], frames[1])]:
        with contextlib.suppress(TransformException):  # the pair that has a stamp of its own
            stamps.append(o.latest_common_time(a, b) or 0)
    return [o.way(frame, stamp_ns) for stamp_ns in stamps for frame in frames]


def is_open(o: Oracle, call: Call, right: object, given: object) -> bool:
    return any(difference(o, call, right, given) for difference in OPEN)


def refused_after_a_time_jump(o: Oracle, call: Call, right: object) -> bool:
    """With ``time_jump="clear"`` a write that jumps back and is then refused (a cycle) has cleared
    the tree all the same. From there on the two have nothing in common."""
    if o.time_jump != "clear" or not isinstance(right, Fault):
        return False
    if call.method not in {"set_transform", "set_transforms_xact"}:
        return False
    rows, _, static = call.arguments
    rows = [rows] if isinstance(rows, Row) else rows
    try:
        _, happened = o.with_rows(o.links, [o.checked(row) for row in rows], static)
    except TransformException:
        return False
    return any(what == "dropped" for _, what in happened)


OPEN: list[Callable[[Oracle, Call, object, object], bool]] = [
    depth_that_is_just_reached,
    two_ways_in_a_past_loop,
]
