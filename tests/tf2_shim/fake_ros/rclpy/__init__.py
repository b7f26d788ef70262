"""The parts of rclpy that a script with timers needs, without any communication."""

import time as _time

from . import duration, node, time


def init(args: object = None) -> None:
    pass


def shutdown() -> None:
    pass


def spin_once(a_node: node.Node) -> None:
    for _, callback in a_node.timers:
        callback()


def spin(a_node: node.Node) -> None:
    """Calls the timers in their periods, until the process is interrupted."""
    due_s = [_time.monotonic() + period_s for period_s, _ in a_node.timers]
    while True:
        _time.sleep(max(0.0, min(due_s, default=_time.monotonic() + 1.0) - _time.monotonic()))
        for at, (period_s, callback) in enumerate(a_node.timers):
            if due_s[at] <= _time.monotonic():
                due_s[at] += period_s
                callback()


__all__ = ["duration", "init", "node", "shutdown", "spin", "spin_once", "time"]
