"""sensor_msgs/JointState as ROS 2's nodes send it: encoded by rosbags, not by the project."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

TYPE = "sensor_msgs::msg::dds_::JointState_"
HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES: Any = STORE.types


def encode(
    names: Sequence[str], positions: Sequence[float], stamp_ns: int = 0, order: str = "little"
) -> bytes:
    nothing = np.empty(0)
    header = TYPES["std_msgs/msg/Header"](
        TYPES["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), ""
    )
    message = TYPES["sensor_msgs/msg/JointState"](
        header, list(names), np.array(positions, float), nothing, nothing
    )
    kind = "sensor_msgs/msg/JointState"
    return bytes(STORE.serialize_cdr(message, kind, little_endian=order == "little"))
