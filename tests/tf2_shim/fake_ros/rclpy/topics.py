"""Topics between the nodes of a process. Messages are delivered as to a MultiThreadedExecutor and
callbacks of a ReentrantCallbackGroup: on a thread of each subscription."""

from __future__ import annotations

import copy
import queue
import threading
from collections.abc import Callable
from typing import Any

from .qos import DurabilityPolicy

_subscriptions: list[Subscription] = []
_publishers: list[Publisher] = []


class Subscription:
    def __init__(self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
        self.kind, self.topic, self.callback, self.qos = kind, topic, callback, qos
        self.messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._run, daemon=True).start()
        for publisher in _publishers:
            if publisher.topic == topic and publisher.last is not None and _is_kept(qos):
                self.messages.put(publisher.last)
        _subscriptions.append(self)

    def _run(self) -> None:
        while True:
            self.callback(self.messages.get())


class Publisher:
    def __init__(self, kind: type, topic: str, qos: Any) -> None:
        self.kind, self.topic, self.qos = kind, topic, qos
        self.last: Any = None
        _publishers.append(self)

    def publish(self, message: Any) -> None:
        assert type(message) is self.kind
        message = copy.deepcopy(message)
        if _is_kept(self.qos):
            self.last = message
        for subscription in _subscriptions:
            if subscription.topic == self.topic:
                subscription.messages.put(message)


def remove(subscription: Subscription) -> None:
    _subscriptions.remove(subscription)


def _is_kept(qos: Any) -> bool:
    return getattr(qos, "durability", None) is DurabilityPolicy.TRANSIENT_LOCAL
