"""Limits of motion in the configuration file, for estimates (docs/how-to/estimate.md).

[motion_limits.base_link]
max_speed_m_s = 1.0
max_rate_rad_s = 1.5
max_clock_error_s = 0.005
"""

from __future__ import annotations

import difflib
from typing import Any, Final

from zenoh_tf import TransformTree
from zenoh_tf.errors import InvalidArgumentException, must_be
from zenoh_tf.estimate import MOTION_LIMITS
from zenoh_tf.text import quoted

#: The section of the file.
SECTION: Final = "motion_limits"
#: As many as one message may have, also with the longest names.
_MOST: Final = 200

#: By child, what `TransformTree.set_motion_limits` takes.
MotionLimits = dict[str, dict[str, float]]


def parse(tables: Any) -> MotionLimits:
    """The limits in the section.

    Raises:
        InvalidArgumentException: The section is wrong; the message names the key.
    """
    if not isinstance(tables, dict):
        raise InvalidArgumentException(
            f"write limits of motion in tables [{SECTION}.FRAME]", field=SECTION
        )
    if len(tables) > _MOST:
        raise must_be(SECTION, f"of {_MOST} frames at most", f"of {len(tables)}")
    tree = TransformTree()
    for child, table in tables.items():
        _check(tree, child, table)
    return tables


def declare(tree: TransformTree, limits: MotionLimits) -> None:
    """Declare the limits to a tree."""
    for child, named in limits.items():
        tree.set_motion_limits(child, **named)


def _check(tree: TransformTree, child: str, table: Any) -> None:
    key = f"{SECTION}.{child}"
    if not isinstance(table, dict):
        raise must_be(key, "a table such as { max_speed_m_s = 1.0 }", table)
    for name, value in table.items():
        field = f"{key}.{name}"
        if name not in MOTION_LIMITS:
            nearest = difflib.get_close_matches(name, MOTION_LIMITS, 1)
            hint = f"did you mean {nearest[0]!r}?" if nearest else f"use {', '.join(MOTION_LIMITS)}"
            raise InvalidArgumentException(f"unknown key {quoted(field)}: {hint}", field=field)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
            raise must_be(field, "a number, 0 or more", value)
    try:
        declare(tree, {child: table})
    except InvalidArgumentException as error:
        raise InvalidArgumentException(f"[{key}]: {error}", field=key) from error
