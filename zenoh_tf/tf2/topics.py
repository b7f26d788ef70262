"""The topics /tf and /tf_static: those of a node of rclpy, or the process's own without one.

A node is any object with rclpy's `create_publisher` and `create_subscription`. The process's topics
connect the broadcasters and listeners of one process. They deliver in the thread that sends.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from types import SimpleNamespace
from typing import Any, Final

from zenoh_tf import StampedTransform

from .messages import fill, message_of

TF: Final = "/tf"
TF_STATIC: Final = "/tf_static"
#: Gets a TFMessage.
Callback = Callable[[Any], object]
#: Sends transforms.
Send = Callable[[list[StampedTransform]], None]

_lock = threading.RLock()  # a callback may send
_subscribers: dict[object, tuple[str, Callback]] = {}
_statics: dict[str, StampedTransform] = {}  # the last of each child, for later subscribers


def is_node(node: Any) -> bool:
    """Whether an object has topics."""
    return hasattr(node, "create_subscription") and hasattr(node, "create_publisher")


def subscribe(
    node: Any, topic: str, callback: Callback, qos: Any, *, static: bool
) -> Callable[[], object]:
    """Call back with the messages of a topic. Returns what ends that."""
    if is_node(node):
        from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: PLC0415 - ROS 2's
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415

        # So that a node with several threads receives while one of its callbacks waits.
        group = ReentrantCallbackGroup()
        subscription = node.create_subscription(
            TFMessage, topic, callback, qos or _qos(static), callback_group=group
        )
        return lambda: node.destroy_subscription(subscription)
    key = object()
    with _lock:
        _subscribers[key] = _name(topic), callback
        if _name(topic) == TF_STATIC and _statics:
            callback(_message(_statics.values()))
    return lambda: _subscribers.pop(key, None)


def publisher(node: Any, qos: Any, *, static: bool) -> Send:
    """Return what publishes on /tf, or with `static` on /tf_static."""
    if not is_node(node):
        return _send_static if static else _send
    from geometry_msgs.msg import TransformStamped  # noqa: PLC0415 - ROS 2's
    from tf2_msgs.msg import TFMessage  # noqa: PLC0415

    topic = node.create_publisher(TFMessage, TF_STATIC if static else TF, qos or _qos(static))
    sent: dict[str, StampedTransform] = {}

    def send(stampeds: list[StampedTransform]) -> None:
        if static:  # a late subscriber gets the last message only
            with _lock:
                sent.update((each.child_frame, each) for each in stampeds)
                stampeds = list(sent.values())
        message = TFMessage()
        message.transforms = [fill(TransformStamped(), message_of(each)) for each in stampeds]
        topic.publish(message)

    return send


def _send(stampeds: list[StampedTransform], topic: str = TF) -> None:
    with _lock:
        callbacks = [callback for name, callback in _subscribers.values() if name == topic]
    for callback in callbacks:
        callback(_message(stampeds))


def _send_static(stampeds: list[StampedTransform]) -> None:
    with _lock:  # of two values, all subscribers get the same one last
        _statics.update((each.child_frame, each) for each in stampeds)
        _send(stampeds, TF_STATIC)


def _message(stampeds: Iterable[StampedTransform]) -> SimpleNamespace:
    return SimpleNamespace(transforms=[message_of(each) for each in stampeds])


def _name(topic: str) -> str:
    return "/" + topic.strip("/")


def _qos(static: bool) -> Any:
    """The quality of service of tf2's topics."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile  # noqa: PLC0415 - ROS 2's

    durability = DurabilityPolicy.TRANSIENT_LOCAL if static else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=100, durability=durability, history=HistoryPolicy.KEEP_LAST)
