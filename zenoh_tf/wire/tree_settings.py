"""The settings of a server's tree, which a mirror's tree shares: a part of a snapshot's plan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from .estimates import MotionLimits, motion_limits_fields, parse_motion_limits
from .fields import Message, integer, malformed

#: The start of no server takes longer.
_MAX_STARTUP_NS: Final = 3600 * 10**9


@dataclass(slots=True)
class TreeSettings:
    """The settings that a mirror's tree must share with the server's."""

    cache_ns: int
    max_frames: int
    max_samples_per_frame: int
    max_name_bytes: int
    max_depth: int
    motion_limits: MotionLimits = field(default_factory=dict)
    #: How long ago the server started, and for how long its publishers may not be back; None: over.
    startup_ns: tuple[int, int] | None = None

    def fields(self) -> Message:
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        startup = {} if self.startup_ns is None else {"startup_ns": [*self.startup_ns]}
        return numbers | motion_limits_fields(self.motion_limits) | startup


_NUMBERS: Final = TreeSettings.__slots__[:5]


def parse_tree_settings(settings: Message) -> TreeSettings:
    """The settings in a map. Raises ProtocolError if it is malformed."""
    numbers = {
        name: integer(settings, name, low=0 if name == "max_depth" else 1)  # 0: no limit
        for name in _NUMBERS
    }
    return TreeSettings(
        **numbers,
        motion_limits=parse_motion_limits(settings),
        startup_ns=_parse_startup(settings),
    )


def _parse_startup(settings: Message) -> tuple[int, int] | None:
    if "startup_ns" not in settings:
        return None
    found = settings["startup_ns"]
    if type(found) is not list or [type(each) for each in found] != [int, int]:
        raise malformed("startup_ns", "two numbers")
    elapsed_ns, left_ns = (min(max(each, 0), _MAX_STARTUP_NS) for each in found)
    return elapsed_ns, left_ns
