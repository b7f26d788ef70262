"""Makes recordings with the writers of other libraries."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

#: (log time in s, topic, [(parent, child, stamp in s, x)])
Log = Iterable[tuple[float, str, list[tuple[str, str, float, float]]]]

TF = "tf2_msgs/msg/TFMessage"
#: Half a second of a static link, a moving one at 50 Hz, and another robot.
LOG: Log = [
    (100.0, "/tf_static", [("base", "camera", 0.0, 1.0)]),
    *[(100.0 + i / 50, "/tf", [("odom", "base", 7.0 + i / 50, float(i))]) for i in range(51)],
    (101.1, "/robot2/tf", [("odom2", "base2", 7.0, 5.0)]),
]
#: What `write` can make.
KINDS = ("mcap", "db3", "bag", "protobuf", "json", "ros1", "unchunked")


def write(path: Path, log: Log = LOG, *, kind: str = "mcap") -> Path:
    """A recording of transform messages; returns the file or folder to read."""
    match kind:
        case "protobuf":
            return _protobuf(path, log)
        case "json" | "ros1" | "unchunked":
            return _plain(path, log, kind)
    ros1 = kind == "bag"
    store = _store(ros1)
    writer: Any
    if ros1:
        writer = Writer1(path)
        serialize = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        serialize = store.serialize_cdr
    with writer:
        topics: dict[str, Any] = {}
        for log_s, topic, rows in log:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, TF, typestore=store)
            message = _ros_message(store, rows, ros1)
            writer.write(topics[topic], round(log_s * 1e9), serialize(message, TF))
    return next(path.glob("*.mcap")) if kind == "mcap" else path


def _store(ros1: bool) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def _ros_message(store: Any, rows: list[tuple[str, str, float, float]], ros1: bool) -> Any:
    kinds = store.types
    transforms = []
    for parent, child, stamp_s, x in rows:
        stamp = kinds["builtin_interfaces/msg/Time"](int(stamp_s), round(stamp_s % 1 * 1e9))
        extra = {"seq": 0} if ros1 else {}
        transforms.append(
            kinds["geometry_msgs/msg/TransformStamped"](
                header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=parent, **extra),
                child_frame_id=child,
                transform=kinds["geometry_msgs/msg/Transform"](
                    translation=kinds["geometry_msgs/msg/Vector3"](x, 0.0, 0.0),
                    rotation=kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                ),
            )
        )
    return kinds[TF](transforms)


def _protobuf(path: Path, log: Log) -> Path:
    """Foxglove's messages, as their own library writes them."""
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for log_s, topic, rows in log:
            message = FrameTransforms()
            for parent, child, stamp_s, x in rows:
                row = message.transforms.add()
                row.parent_frame_id, row.child_frame_id = parent, child
                row.timestamp.FromNanoseconds(round(stamp_s * 1e9))
                row.translation.x = x
                row.rotation.w = 1.0
            time_ns = round(log_s * 1e9)
            writer.write_message(topic, message, log_time=time_ns, publish_time=time_ns)
    return path


def _plain(path: Path, log: Log, kind: str) -> Path:
    """Messages that the `mcap` library does not encode itself, and a topic without transforms."""
    schema_of = {
        "json": ("foxglove.FrameTransforms", "jsonschema", "json"),
        "ros1": ("tf2_msgs/TFMessage", "ros1msg", "ros1"),
        "unchunked": (TF, "ros2msg", "cdr"),
    }
    name, schema_encoding, encoding = schema_of[kind]
    store = _store(kind == "ros1")
    with path.open("wb") as file:
        writer = McapWriter(
            file, use_chunking=kind != "unchunked", compression=CompressionType.LZ4, chunk_size=500
        )
        writer.start()
        text = writer.register_channel(
            "/text", "json", writer.register_schema("Text", "jsonschema", b"{}")
        )
        schema = writer.register_schema(name, schema_encoding, b"")
        topics: dict[str, int] = {}
        for log_s, topic, rows in log:
            time_ns = round(log_s * 1e9)
            if topic not in topics:
                topics[topic] = writer.register_channel(topic, encoding, schema)
            if kind == "json":
                data = json.dumps({"transforms": [*map(_json_row, rows)]}).encode()
            else:
                serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
                data = bytes(serialize(_ros_message(store, rows, kind == "ros1"), TF))
            writer.add_message(text, time_ns, b'"unread"', time_ns)
            writer.add_message(topics[topic], time_ns, data, time_ns)
        writer.finish()
    return path


def _json_row(row: tuple[str, str, float, float]) -> dict[str, Any]:
    parent, child, stamp_s, x = row
    return {
        "timestamp": {"sec": int(stamp_s), "nsec": round(stamp_s % 1 * 1e9)},
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": x, "y": 0.0, "z": 0.0},
        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def malformed_cdr(count: int) -> bytes:
    """A TFMessage that ends before its transforms."""
    return b"\0\1\0\0" + struct.pack("<I", count)
