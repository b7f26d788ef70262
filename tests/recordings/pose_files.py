"""Makes recordings of messages with one pose, by the writers of `rosbags`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

#: (log time in s, topic, type, parent, child, stamp in s, x)
Poses = Iterable[tuple[float, str, str, str, str, float, float]]

TRANSFORM = "geometry_msgs/msg/TransformStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def write_poses(path: Path, log: Poses, *, kind: str = "mcap") -> Path:
    """A "mcap", "db3" or ROS 1 "bag" of poses; returns the file or folder to read."""
    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        topics: dict[str, Any] = {}
        for log_s, topic, message_type, parent, child, stamp_s, x in log:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message_type, typestore=store)
            message = _message(store.types, message_type, parent, child, stamp_s, x)
            serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
            writer.write(topics[topic], round(log_s * 1e9), serialize(message, message_type))
    return next(path.glob("*.mcap")) if kind == "mcap" else path


def _message(
    kinds: Any, message_type: str, parent: str, child: str, stamp_s: float, x: float
) -> Any:
    def geometry(name: str, *args: Any) -> Any:
        return kinds[f"geometry_msgs/msg/{name}"](*args)

    stamp = kinds["builtin_interfaces/msg/Time"](int(stamp_s), round(stamp_s % 1 * 1e9))
    header_type = kinds["std_msgs/msg/Header"]
    extra = {"seq": 0} if "seq" in header_type.__dataclass_fields__ else {}
    header = header_type(stamp=stamp, frame_id=parent, **extra)
    turn = geometry("Quaternion", 0.0, 0.0, 0.0, 1.0)
    if message_type == TRANSFORM:
        at = geometry("Vector3", x, 0.0, 0.0)
        return geometry("TransformStamped", header, child, geometry("Transform", at, turn))
    pose = geometry("Pose", geometry("Point", x, 0.0, 0.0), turn)
    if message_type == POSE:
        return geometry("PoseStamped", header, pose)
    covariance = np.eye(6).ravel() / 100
    wide = geometry("PoseWithCovariance", pose, covariance)
    if message_type == POSE_COVARIANCE:
        return geometry("PoseWithCovarianceStamped", header, wide)
    still = geometry("Vector3", 0.0, 0.0, 0.0)
    twist = geometry("TwistWithCovariance", geometry("Twist", still, still), covariance)
    return kinds[ODOMETRY](header, child, wide, twist)
