"""The checks of poses: quaternions, static values, jumps, frozen poses, units and mounts."""

from __future__ import annotations

import re
from statistics import median
from typing import Final

import numpy as np

from zenoh_tf.text import quoted
from zenoh_tf.text.times import age, seconds
from zenoh_tf_tools.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.words import (
    Evidence,
    authority,
    by_publisher,
    length,
    listed,
    shift,
    times,
)

_NORM_ERROR: Final = 1e-3
#: A robot's part that is farther from its body is placed in millimetres: this far, or so many times
#: as far as its other parts.
_FAR_M: Final = 20.0
_FAR_TIMES: Final = 100.0
#: A frame that does not move is a body if it has so many other parts, half of them this near.
_PARTS: Final = 3
_NEAR_M: Final = 2.0
#: Nothing on the ground is so fast.
_FAST_M_S: Final = 50.0
_IDENTITY_RAD: Final = 0.02
#: How far a mount that should be rigid moves, from and to.
_WOBBLE_M: Final = (0.0005, 0.05)
_SENSOR: Final = re.compile(r"camera|lidar|laser|imu|gnss|gps|radar|sonar|sensor|mount")
_WORLDS: Final = {"map", "odom", "world", "earth", "utm"}


def not_unit(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        error = 0.0 if link.seen is None else link.seen.norm_error
        if error > _NORM_ERROR:
            yield link.frame.name, f"the norm of a quaternion is {error:.4f} off 1"


def replaced(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        change = None if link.seen is None else link.seen.replaced
        kept = link.frame.last_replacement
        if change is not None:
            before, after = change.before, change.after
            moved, when = shift(change.shift_m, change.turn_rad), times(change.count)
        elif kept is not None and link.frame.static and facts.ago_s(kept.at_ns) is not None:
            before, after = kept.authority_before, link.frame.authority
            ago_s = facts.ago_s(kept.at_ns) or 0.0
            moved = shift(kept.shift_m, kept.turn_rad)
            when = f"{times(kept.count)}, {age(max(0, round(ago_s * 1e9)))} ago"
        else:
            continue
        by = authority(after)
        by += "" if before == after else f", before it was by {authority(before)}"
        yield (
            link.frame.name,
            f"its static value was replaced {when}, the last time by one that is {moved} off; now "
            f"it is by {by}",
        )


def jumps(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        jump = seen.motion.jump
        if jump is None:
            continue
        more = seen.motion.jumps - 1
        again = f"; {times(more)} more since" if more else ""
        usual = f"and otherwise at most at {jump.usual_m_s:.2f} m/s"
        if jump.shift_m == 0.0:
            usual = "and otherwise turned by far less"
        yield by_publisher(
            link,
            f"it moved {shift(jump.shift_m, jump.turn_rad)} within {age(round(jump.took_s * 1e9))} "
            f"at {seconds(jump.stamp_ns)} s, {usual}{again}",
        )


def frozen(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        freeze = seen.motion.freeze
        if freeze is None:
            continue
        others = [each for each in facts.seen if each[0] is not link]
        half_ns = (freeze.start_ns + freeze.end_ns) // 2
        moving = [
            other.frame.name for other, its in others if (its.motion.moved_ns or half_ns) > half_ns
        ]
        if others and not moving:
            continue  # all of it stands still
        meanwhile = f", while {listed(moving)} moved" if moving else ""
        yield by_publisher(
            link,
            f"its pose is the same to the last bit in {freeze.samples + 1:,} samples over "
            f"{age(freeze.end_ns - freeze.start_ns)}{meanwhile}; before, it moved at "
            f"{freeze.speed_m_s:.2f} m/s and {freeze.speed_rad_s:.2f} rad/s",
        )


def millimetres(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        seen = link.seen
        if seen is None:
            continue
        jump, change = seen.motion.jump, seen.replaced
        if (jump is not None and jump.is_milli) or (change is not None and change.is_milli):
            metres = jump.shift_m if jump is not None else change.shift_m if change else 0.0
            yield link.frame.name, f"its length changed about 1,000 times, by {length(metres)}"
        elif seen.motion.speed_m_s > _FAST_M_S:
            yield by_publisher(link, f"it moves at {seen.motion.speed_m_s:,.0f} m/s")
        elif (usual_m := _too_far(facts, link)) is not None:
            others = f", and the other parts of that body {length(usual_m)}" if usual_m else ""
            yield by_publisher(
                link, f"it is {length(_distance_m(link))} from {quoted(link.frame.parent)}{others}"
            )


def optical(facts: TreeFacts) -> Evidence:
    for link in facts.links:
        name, parent = _last_part(link.frame.name), _last_part(link.frame.parent)
        if link.seen is None or "optical" not in name or "optical" in parent:
            continue
        turn = 2 * np.arccos(min(1.0, abs(float(link.seen.pose[6]))))
        if turn < _IDENTITY_RAD:
            yield (
                link.frame.name,
                f"it is turned by {turn:.3f} rad in {quoted(link.frame.parent)}; an optical frame "
                "has z forwards and x to the right: quaternion -0.5 0.5 -0.5 0.5, rpy -90 0 -90 "
                "degrees",
            )


def wobbling(facts: TreeFacts) -> Evidence:
    for link, seen in facts.seen:
        name, parent = _last_part(link.frame.name), _last_part(link.frame.parent)
        if parent in _WORLDS or not _SENSOR.search(name):
            continue
        wobble_m = seen.motion.wobble_m
        if _WOBBLE_M[0] < wobble_m < _WOBBLE_M[1]:
            yield by_publisher(
                link,
                f"it moves by {length(wobble_m)} about its place in {quoted(link.frame.parent)}",
            )


def _last_part(name: str | None) -> str:
    """A frame's name without the robot's, in lower case."""
    return (name or "").rpartition("/")[2].casefold()


def _distance_m(link: LinkFacts) -> float:
    if link.seen is None:
        return 0.0
    if link.seen.motion.distance_m is not None and not link.frame.static:
        return link.seen.motion.distance_m
    return float(np.linalg.norm(link.seen.pose[:3]))


def _too_far(facts: TreeFacts, link: LinkFacts) -> float | None:
    """The usual distance of a body's parts if this one is much farther away, 0 if it has no other;
    None if it is not, or is no part of a body."""
    parent = link.frame.parent
    distance_m = _distance_m(link)
    if parent is None or distance_m < _FAR_M or _last_part(parent) in _WORLDS:
        return None
    parts = [other for other in facts.links if other.frame.parent == parent]
    carried = any(
        not facts.frames[name].static and facts.frames[name].parent is not None
        for name in facts.ancestors(parent)
        if name in facts.frames
    )
    others = [_distance_m(other) for other in parts if other is not link]
    usual_m = median(others) if others else 0.0
    # A body moves, or has parts that are as near as a robot's.
    if not carried and (len(others) < _PARTS or usual_m > _NEAR_M):
        return None
    if not any(other.frame.static for other in parts):
        return None
    return usual_m if distance_m > _FAR_TIMES * usual_m else None
