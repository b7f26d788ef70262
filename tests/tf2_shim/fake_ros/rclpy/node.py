"""rclpy.node"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from . import topics
from .time import Time


class Clock:
    def now(self) -> Time:
        return Time(nanoseconds=time.time_ns())


class Logger:
    def info(self, text: str) -> None:
        print(text, flush=True)


class Node:
    def __init__(self, name: str, namespace: str = "") -> None:
        self.timers: list[tuple[float, Callable[[], None]]] = []
        self._name = name
        self._namespace = namespace

    def get_name(self) -> str:
        return self._name

    def get_fully_qualified_name(self) -> str:
        return f"{self._namespace}/{self._name}"

    def get_clock(self) -> Clock:
        return Clock()

    def get_logger(self) -> Logger:
        return Logger()

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        self.timers.append((period_s, callback))

    def create_subscription(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: Any,
        *,
        callback_group: Any = None,
    ) -> topics.Subscription:
        return topics.Subscription(kind, topic, callback, qos)

    def destroy_subscription(self, subscription: topics.Subscription) -> None:
        topics.remove(subscription)

    def create_publisher(self, kind: type, topic: str, qos: Any) -> topics.Publisher:
        return topics.Publisher(kind, topic, qos)

    def destroy_node(self) -> None:
        pass
