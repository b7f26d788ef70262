"""The parts of rclpy that a script with timers needs, without any communication."""

from . import duration, node, time


def init(args: object = None) -> None:
    pass


def shutdown() -> None:
    pass


def spin_once(a_node: node.Node) -> None:
    for callback in a_node.timers:
        callback()


__all__ = ["duration", "init", "node", "shutdown", "spin_once", "time"]
