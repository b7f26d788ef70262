"""Links that are static for one publisher and moving, or elsewhere, for another one.

A calibration that a left-over node overrides is one, and a calibration of a frame that a driver
places already.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from zenoh_tf._core import Transform
from zenoh_tf.introspection.frame_info import FrameChange
from zenoh_tf.text import quoted
from zenoh_tf_tools.doctor.facts import LinkFacts, TreeFacts
from zenoh_tf_tools.doctor.observation import Pose
from zenoh_tf_tools.doctor.words import Evidence, authority, times

_METRES: Final = "x {:g} y {:g} z {:g} m"
_QUATERNION: Final = "quaternion x {:g} y {:g} z {:g} w {:g}"


def takeovers(facts: TreeFacts) -> Evidence:
    """Yield the links that were static, and that another authority has written since: as moving
    links, or below a parent of another tree. Also those that it turned back while it was
    observed."""
    for link in facts.links:
        frame, change = link.frame, link.frame.last_change
        if change is None or frame.parent is None or change.authority != frame.authority:
            continue
        if not change.authority_before or change.authority in ("", change.authority_before):
            continue
        root = _lost_root(facts, frame.parent, change)
        if facts.is_complete and root is None:
            continue  # the topics of a recording may be one node's
        if change.static_before:
            # A static value that is replaced by another one is TF402.
            is_fault = not frame.static or root is not None
        else:
            is_fault = frame.static and bool(facts.grown(link, "authority_changes"))
        if is_fault:
            yield frame.name, _evidence(facts, link, change, root)


def _lost_root(facts: TreeFacts, parent: str, change: FrameChange) -> str | None:
    """Return the root of the tree that the change has split off; ``None`` if it has split none."""
    before = change.parent_before
    if before is None or before == parent or before not in facts.frames:
        return None
    root = facts.ancestors(before)[-1]
    return root if root != facts.ancestors(parent)[-1] else None


def _evidence(facts: TreeFacts, link: LinkFacts, change: FrameChange, root: str | None) -> str:
    frame = link.frame
    one, other = authority(change.authority_before), authority(change.authority)
    before, now = (
        "static" if static else "moving" for static in (change.static_before, frame.static)
    )
    if change.parent_before not in (None, frame.parent):
        before += f" below {quoted(change.parent_before)}"
        now += f" below {quoted(frame.parent)}; its parent has changed {times(frame.reparented)}"
    text = f"{one} has published the link as {before}, and {other} publishes it as {now}"
    if not frame.static and facts.has_stopped(link):
        text += f"; {other} has ended: the link is its last word until {one} announces it again"
    if root is not None:
        text += f"; {quoted(root)} has lost its connection: {_cure(facts, link, change, root)}"
    return text


def _cure(facts: TreeFacts, link: LinkFacts, change: FrameChange, root: str) -> str:
    """Return what to publish in place of the link, so that the frame keeps the parent that it
    had: the pose of the other tree's root."""
    parent, child = quoted(link.frame.parent), quoted(link.frame.name)
    advice = f"let {authority(change.authority)} publish {parent} -> {quoted(root)} instead"
    product = f"its pose times the inverse of {quoted(root)} -> {child}"
    X_root_child = _static_pose(facts, root, change)
    if X_root_child is None or link.seen is None:
        return f"{advice}, {product}"
    X = _transform(link.seen.pose) @ X_root_child.inverse()
    x, y, z, *rotation = (round(value, 6) + 0.0 for value in X.pose())
    numbers = f"{_METRES.format(x, y, z)}, {_QUATERNION.format(*rotation)}"
    return f"{advice}, at {numbers} ({product})"


def _static_pose(facts: TreeFacts, root: str, change: FrameChange) -> Transform | None:
    """Return ``X_root_child`` as it was, if all links between the two are static and known."""
    if len(change.pose_before) != 7 or change.parent_before is None:
        return None
    X = _transform(change.pose_before)
    known = {link.frame.name: link for link in facts.links}
    for name in facts.ancestors(change.parent_before):
        if name == root:
            return X
        link = known[name]
        if not link.frame.static or link.seen is None:
            return None
        X = _transform(link.seen.pose) @ X
    return None


def _transform(pose: Sequence[float] | Pose) -> Transform:
    x, y, z, qx, qy, qz, qw = map(float, pose)
    return Transform((x, y, z), (qx, qy, qz, qw))
