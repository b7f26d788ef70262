"""Messages of ROS 2 and ROS 1 as objects, decoded with ``rosbags``."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from .errors import missing_library

#: Foxglove's messages as packages of ROS have them.
_FOXGLOVE: Final = {
    "foxglove_msgs/msg/FrameTransform": """\
builtin_interfaces/Time timestamp
string parent_frame_id
string child_frame_id
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""",
    "foxglove_msgs/msg/FrameTransforms": "foxglove_msgs/FrameTransform[] transforms\n",
}


def full_type(message_type: str) -> str:
    """The name of a type of ROS with "/msg/", which ROS 1 leaves out."""
    package, _, name = message_type.partition("/")
    return f"{package}/msg/{name.removeprefix('msg/')}"


def ros_message(message_type: str, encoding: str, data: bytes) -> Any:
    """A message of a full type in "cdr" or "ros1". Raises any exception if it is malformed."""
    return _deserializer(encoding)(data, message_type)


@cache
def _deserializer(encoding: str) -> Callable[[bytes, str], Any]:
    try:
        from rosbags.typesys import (  # noqa: PLC0415 - an extra
            Stores,
            get_types_from_msg,
            get_typestore,
        )
    except ImportError as error:
        raise missing_library(error) from error
    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for name, definition in _FOXGLOVE.items():
        types.update(get_types_from_msg(definition, name))
    store.register(types)
    return store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
