"""The counters of `stats` in its reply: those of robots in a list, as a map has few keys."""

from __future__ import annotations

from typing import Any

from ..errors import ProtocolError
from .fields import Message

#: The field with what is counted for each robot (`--mirror-of`).
_ROBOTS = "robots"


def stats_value(counters: dict[str, Any]) -> Message:
    """The value of a reply. A counter NAME/ROBOT stands in the map of its robot."""
    value: Message = {}
    robots: dict[str, Message] = {}
    for key, count in counters.items():
        name, slash, robot = key.partition("/")
        if slash:
            robots.setdefault(robot, {"name": robot})[name] = count
        else:
            value[key] = count
    return value | {_ROBOTS: list(robots.values())} if robots else value


def parse_stats(value: Message) -> dict[str, Any]:
    """The counters in the value of a reply. Raises ProtocolError."""
    counters = {name: count for name, count in value.items() if name != _ROBOTS}
    for robot in value.get(_ROBOTS, ()):
        if type(robot) is not dict or type(robot.get("name")) is not str:
            raise ProtocolError("the reply has robots without a name", field=_ROBOTS)
        for name, count in robot.items():
            if name != "name":
                counters[f"{name}/{robot['name']}"] = count
    return counters
