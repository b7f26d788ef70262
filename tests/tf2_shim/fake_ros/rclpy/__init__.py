"""rclpy, as far as a script with timers needs it; nothing of it talks to anyone."""

from . import duration, node, time


def init(args: object = None) -> None:
    pass


def shutdown() -> None:
    pass


def spin_once(a_node: node.Node) -> None:
    for callback in a_node.timers:
        callback()


__all__ = ["duration", "init", "node", "shutdown", "spin_once", "time"]
