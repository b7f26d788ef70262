"""sensor_msgs.msg, as far as transforms need it."""

from array import array
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import Header


@dataclass(slots=True)
class PointField:
    name: str = ""
    offset: int = 0
    datatype: int = 0
    count: int = 0


@dataclass(slots=True)
class PointCloud2:
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    fields: list[PointField] = field(default_factory=list)
    is_bigendian: bool = False
    point_step: int = 0
    row_step: int = 0
    data: Any = field(default_factory=lambda: array("B"))
    is_dense: bool = False
