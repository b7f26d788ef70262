"""Links by a word, and a small robot's frames."""

from __future__ import annotations

from itertools import pairwise

from zenoh_tf import StampedTransform, Transform
from zenoh_tf_client import TransformClient

DEADLINE_S = 30.0


def link(parent: str, child: str, stamp_ns: int = 0, x: float = 0.0) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, Transform((x, 0, 0)))


def stamped(child: str, stamp_ns: int, x: float = 0.0, parent: str = "map") -> StampedTransform:
    return link(parent, child, stamp_ns, x)


def robot(tf: TransformClient, stamp: int, prefix: str = "") -> None:
    """map -> odom -> base -> (arm -> gripper, camera)"""
    names = ["map", "odom", "base", "arm", "gripper"]
    links = [stamped(prefix + b, stamp, stamp, prefix + a) for a, b in pairwise(names)]
    tf.set_transforms_xact([*links, stamped(prefix + "camera", stamp, 2, prefix + "base")])
