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
from zenoh_tf.errors import must_be

from .messages import fill, message_of

TF: Final = "/tf"
TF_STATIC: Final = "/tf_static"
#: Sends transforms.
Send = Callable[[list[StampedTransform]], None]

_lock = threading.RLock()  # a callback may send
_subscribers: dict[object, tuple[str, Callable[[Any], object]]] = {}
_statics: dict[str, StampedTransform] = {}  # the last of each child, for later subscribers


def has_topics(node: Any) -> bool:
    """Whether an object is a node with topics of its own."""
    return hasattr(node, "create_subscription") and hasattr(node, "create_publisher")


def check_node(node: Any) -> None:
    """Raise InvalidArgumentException if an object other than None has neither topics nor a name."""
    if node is not None and not has_topics(node) and not hasattr(node, "get_name"):
        raise must_be("node", "a node of rclpy, or None", node)


def subscribe(
    node: Any, topic: str, callback: Callable[[Any], object], qos: Any, *, static: bool
) -> Callable[[], object]:
    """Call back with the messages of a topic. Returns what ends that."""
    if has_topics(node):
        from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: PLC0415 - ROS 2's
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415

        qos, group = qos or _qos(static), ReentrantCallbackGroup()  # also while a callback waits
        made = node.create_subscription(TFMessage, topic, callback, qos, callback_group=group)
        return lambda: node.destroy_subscription(made)
    key, topic = object(), "/" + topic.strip("/")
    with _lock:
        _subscribers[key] = topic, callback
        if topic == TF_STATIC and _statics:
            callback(_message(_statics.values()))
    return lambda: _subscribers.pop(key, None)


def publisher(node: Any, qos: Any, *, static: bool) -> Send:
    """Return what publishes on /tf, or with `static` on /tf_static."""
    if not has_topics(node):
        return _send_static if static else _send
    from geometry_msgs.msg import TransformStamped  # noqa: PLC0415 - ROS 2's
    from tf2_msgs.msg import TFMessage  # noqa: PLC0415

    qos = qos or _qos(static, depth=1 if static else 100)
    topic = node.create_publisher(TFMessage, TF_STATIC if static else TF, qos)
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
    for name, callback in list(_subscribers.values()):
        if name == topic:
            callback(_message(stampeds))


def _send_static(stampeds: list[StampedTransform]) -> None:
    with _lock:  # of two values, all subscribers get the same one last
        _statics.update((each.child_frame, each) for each in stampeds)
        _send(stampeds, TF_STATIC)


def _message(stampeds: Iterable[StampedTransform]) -> SimpleNamespace:
    return SimpleNamespace(transforms=[message_of(each) for each in stampeds])


def _qos(static: bool, depth: int = 100) -> Any:
    """The quality of service of tf2's topics."""
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile  # noqa: PLC0415 - ROS 2's

    durability = DurabilityPolicy.TRANSIENT_LOCAL if static else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, durability=durability, history=HistoryPolicy.KEEP_LAST)
