"""Writes recordings: MCAP files with ROS 2's TFMessage.

What was written before the last `flush` can be read even if the process is killed: a flush ends a
chunk, and readers that find no end of the file read it from its beginning.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from .._core import TransformRows
from ..ros2.cdr import encode_tf_message
from .errors import missing_library

#: A chunk is written when it has this many bytes, or by `flush`.
_CHUNK_BYTES: Final = 1 << 20
#: How ROS 2 publishes the two topics: players offer the same. Static ones go to late listeners.
_QOS: Final = """\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
_ROS2_TYPE: Final = "tf2_msgs/msg/TFMessage"
_SEPARATOR: Final = "=" * 80
#: The definition of the message and of all that it contains, as ROS 2 recordings have it.
_ROS2_SCHEMA: Final = f"""\
geometry_msgs/TransformStamped[] transforms
{_SEPARATOR}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_SEPARATOR}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_SEPARATOR}
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""


class RecordingWriter:
    """A new MCAP file with the topics /tf and /tf_static. Thread safety: one thread at a time."""

    def __init__(self, path: Path, metadata: dict[str, str]) -> None:
        """Begin the file.

        Args:
            path: Where it is made; nothing may be there.
            metadata: What the file says of its origin.

        Raises:
            RecordingError: A library is missing.
            OSError: The file cannot be made, or exists.
        """
        try:
            from mcap.writer import Writer  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise missing_library(error) from error
        self._file = path.open("xb")
        self._writer: Any = Writer(self._file, chunk_size=_CHUNK_BYTES)
        self._writer.start(profile="ros2")
        self._writer.add_metadata("zenoh-tf", metadata)
        schema = self._writer.register_schema(_ROS2_TYPE, "ros2msg", _ROS2_SCHEMA.encode())
        #: Of moving transforms and of static ones.
        self._channels = [
            self._writer.register_channel(
                topic,
                "cdr",
                schema,
                {"offered_qos_profiles": _QOS.format(depth=depth, durability=durability)},
            )
            # 2: volatile, 1: transient local
            for topic, depth, durability in (("/tf", 100, 2), ("/tf_static", 1, 1))
        ]
        self._file.flush()

    def write(self, log_ns: int, static: bool, rows: TransformRows) -> None:
        """Add a message.

        Args:
            log_ns: When its transforms were received, nanoseconds since 1970.
            static: They hold at all times.
            rows: The transforms.

        Raises:
            InvalidArgumentException: ROS 2's message cannot hold it; `field` is "stamp_ns" or
                "names".
            OSError: The disk is full, or failed.
        """
        self._writer.add_message(
            self._channels[static], log_ns, encode_tf_message(rows), publish_time=log_ns
        )

    def flush(self) -> None:
        """Hand all that was added to the system. Raises OSError."""
        self._writer.flush()

    def close(self) -> None:
        """End the file: only with its index it can be searched quickly. Raises OSError."""
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file without its end, after an error."""
        self._file.close()
