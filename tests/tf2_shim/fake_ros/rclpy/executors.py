"""rclpy.executors"""

import threading

from .node import Node

#: Those that spin now.
spinning: list[Node] = []


class SingleThreadedExecutor:
    def __init__(self) -> None:
        self._stop = threading.Event()
        self._nodes: list[Node] = []

    def add_node(self, node: Node) -> None:
        self._nodes.append(node)

    def spin(self) -> None:
        spinning.extend(self._nodes)
        self._stop.wait()
        for node in self._nodes:
            spinning.remove(node)

    def shutdown(self) -> None:
        self._stop.set()
