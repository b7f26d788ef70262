"""tf2_msgs.msg"""

from dataclasses import dataclass, field

from geometry_msgs.msg import TransformStamped


@dataclass(slots=True)
class TFMessage:
    transforms: list[TransformStamped] = field(default_factory=list)
