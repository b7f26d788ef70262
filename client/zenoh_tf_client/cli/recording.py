"""Reads transforms from ROS recordings (MCAP, ROS 2 folders, ROS 1 bags) with ``rosbags``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zenoh_tf import StampedTransform, Transform, TransformException, TransformTree
from zenoh_tf_client.cli.errors import CommandError

#: The second name is that of ROS 1 before 2013.
_TF_TYPES = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})


@dataclass(frozen=True)
class Message:
    """One recorded message."""

    log_ns: int
    topic: str
    static: bool
    transforms: list[StampedTransform]


class Recording:
    """The transform messages of one recording.

    ``skipped`` counts transforms that every tree rejects, such as NaN or a frame in itself.
    """

    def __init__(self, reader: Any, path: Path) -> None:
        self._reader = reader
        self._path = path
        self._connections = [c for c in reader.connections if c.msgtype in _TF_TYPES]
        if not self._connections:
            raise CommandError(f"{path}: no topic of type tf2_msgs/msg/TFMessage")
        self.topics = sorted({c.topic for c in self._connections})
        self.message_count = sum(c.msgcount for c in self._connections)
        self.skipped = 0
        # One bad row makes the server reject its whole message. A local tree has the same
        # rules; it need not keep anything.
        self._validator = TransformTree(cache_time_s=0.001)

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order of the log."""
        rows = self._reader.messages(connections=self._connections)
        while True:
            # On damaged files rosbags raises exceptions of any kind.
            try:
                connection, log_ns, raw = next(rows)
                decoded = self._reader.deserialize(raw, connection.msgtype)
            except StopIteration:
                return
            except Exception as error:
                raise CommandError(f"{self._path}: {_reason(error)}") from error
            yield Message(
                log_ns,
                connection.topic,
                # Not by the durability, because ROS 1 has none and bridges lose it.
                connection.topic.rsplit("/", 1)[-1] == "tf_static",
                [*self._usable(decoded.transforms)],
            )

    def _usable(self, rows: Iterable[Any]) -> Iterator[StampedTransform]:
        for row in rows:
            try:
                stamped = _stamped(row)
                self._validator.set_transform(stamped)
            except TransformException:
                self.skipped += 1
            else:
                yield stamped


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording. Raises CommandError if it cannot be read, or rosbags is missing."""
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an optional extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise CommandError(
            f"replay reads recordings through rosbags, which is not installed ({error}); "
            "install it with: pip install rosbags"
        ) from error
    if not path.exists():
        raise CommandError(f"{path}: no such file")
    try:
        # Recordings of older ROS 2 releases carry no message definitions.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:
        raise CommandError(f"{path}: not a readable recording: {_reason(error)}") from error
    try:
        yield Recording(reader, path)
    finally:
        reader.close()


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def _stamped(row: Any) -> StampedTransform:
    stamp = row.header.stamp
    at, turn = row.transform.translation, row.transform.rotation
    return StampedTransform(
        row.header.frame_id,
        row.child_frame_id,
        stamp.sec * 10**9 + stamp.nanosec,
        Transform((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w)),
    )
