"""Reads recordings with other libraries, as (topic, rows) of each message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader


def rows(columns: Any) -> list[tuple[Any, ...]]:
    return [
        (columns.names[parent], columns.names[child], stamp, *values)
        for parent, child, stamp, values in zip(
            columns.parent,
            columns.child,
            columns.stamp.tolist(),
            columns.pose.tolist(),
            strict=True,
        )
    ]


def read_with_rosbags(path: Path) -> list[tuple[str, list[tuple[Any, ...]]]]:
    found = []
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            (qos,) = connection.ext.offered_qos_profiles  # type: ignore[union-attr]
            is_static = connection.topic == "/tf_static"
            assert qos.durability.name == ("TRANSIENT_LOCAL" if is_static else "VOLATILE")
            found.append(
                (
                    connection.topic,
                    [
                        (
                            row.header.frame_id,
                            row.child_frame_id,
                            row.header.stamp.sec * 10**9 + row.header.stamp.nanosec,
                            *(getattr(row.transform.translation, axis) for axis in "xyz"),
                            *(getattr(row.transform.rotation, axis) for axis in "xyzw"),
                        )
                        for row in message.transforms
                    ],
                )
            )
    return found
