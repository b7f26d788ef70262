"""The robot's true motion, from which the demo computes how wrong a lookup is.

Each function ``X_parent_child`` returns the pose of the child in its parent at a time in ns.
"""

from __future__ import annotations

import math

from zenoh_tf import Transform

#: Where the object lies, in map. It does not move until it is grasped.
X_map_object = Transform((2.0, 3.0, 0.6))

#: Where the camera sits on the robot.
X_base_camera = Transform((0.25, 0.0, 0.55))


def X_map_odom(stamp_ns: int) -> Transform:
    t = _seconds(stamp_ns)
    return Transform((0.3 * math.sin(0.5 * t), 0.2 * math.cos(0.4 * t), 0.0), _yaw(0.05 * t))


def X_odom_base(stamp_ns: int) -> Transform:
    """A circle of 2 m radius at 0.8 m/s."""
    angle = 0.4 * _seconds(stamp_ns)
    return Transform((2 * math.cos(angle), 2 * math.sin(angle), 0.0), _yaw(angle + math.pi / 2))


def arm(stamp_ns: int) -> list[tuple[str, str, Transform]]:
    """The arm's three joints, as (parent, child, pose of child in parent)."""
    t = _seconds(stamp_ns)
    return [
        ("base_link", "shoulder", Transform((0.1, 0.0, 0.5), _yaw(1.2 * math.sin(2.0 * t)))),
        ("shoulder", "elbow", Transform((0.4, 0.0, 0.0), _yaw(0.9 * math.sin(2.6 * t)))),
        ("elbow", "wrist", Transform((0.3, 0.0, 0.0), _yaw(0.6 * math.sin(3.4 * t)))),
    ]


def X_map_wrist(stamp_ns: int) -> Transform:
    X = X_map_odom(stamp_ns) @ X_odom_base(stamp_ns)
    for _, _, X_parent_child in arm(stamp_ns):
        X = X @ X_parent_child
    return X


def X_camera_object(stamp_ns: int) -> Transform:
    """What the camera sees of the object that lies still in map."""
    X_map_camera = X_map_odom(stamp_ns) @ X_odom_base(stamp_ns) @ X_base_camera
    return X_map_camera.inverse() @ X_map_object


def _seconds(stamp_ns: int) -> float:
    # Modulo an hour, because a double of seconds since 1970 has a resolution of 240 ns. At these
    # speeds that would be visible in the errors that the demo prints.
    return (stamp_ns % (3600 * 10**9)) / 1e9


def _yaw(angle: float) -> tuple[float, float, float, float]:
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
