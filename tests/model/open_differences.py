"""Where the tree does not yet do what the oracle says, with the history that shows it.

The predicate lets a random history end before a known fault; the test of the same name in
``test_open_differences.py`` fails as soon as the fault is gone, and then both go too.
"""

from __future__ import annotations

from zenoh_tf import TransformException

from .calls import Call, Fault
from .oracle import Oracle, Row


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
