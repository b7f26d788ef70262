"""Reads rosbag2 (db3) and ROS 1 bags with ``rosbags``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .container import Choose, RawMessage
from .errors import missing_library


class BagFile:
    """A ``.bag`` or ``.db3`` file, or a folder of ``ros2 bag record``. A `Container`."""

    is_cut_off = False

    def __init__(self, path: Path, choose: Choose, *, ros1: bool) -> None:
        """Open it. Raises RecordingError if rosbags is missing, and what rosbags raises."""
        try:
            from rosbags.rosbag1 import Reader as Reader1  # noqa: PLC0415 - an extra
            from rosbags.rosbag2 import Reader as Reader2  # noqa: PLC0415
        except ImportError as error:
            raise missing_library(error) from error
        self._reader: Any = (Reader1 if ros1 else Reader2)(path)
        self._reader.open()
        encoding = "ros1" if ros1 else "cdr"
        self._channels = {
            connection.id: found
            for connection in self._reader.connections
            if (found := choose(connection.topic, connection.msgtype, encoding))
        }
        self._connections = [c for c in self._reader.connections if c.id in self._channels]
        self.message_count = sum(c.msgcount for c in self._connections)
        self.is_empty = not any(c.msgcount for c in self._reader.connections)

    def messages(self) -> Iterator[RawMessage]:
        """See `Container.messages`."""
        if not self._connections:
            return  # rosbags would yield the messages of all topics
        for connection, log_ns, data in self._reader.messages(connections=self._connections):
            yield RawMessage(log_ns, self._channels[connection.id], bytes(data))

    def close(self) -> None:
        """Close the files."""
        self._reader.close()
