"""rclpy.qos"""

import enum
from dataclasses import dataclass


class DurabilityPolicy(enum.Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class HistoryPolicy(enum.Enum):
    KEEP_LAST = 1


@dataclass
class QoSProfile:
    depth: int
    durability: DurabilityPolicy
    history: HistoryPolicy
