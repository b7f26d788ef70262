"""`TransformListener`, `StaticTransformListener`: do nothing, so that a script need not change."""

from __future__ import annotations

from typing import Any, Final

from zenoh_tf.errors import InvalidArgumentException

from .buffer import BufferInterface

#: tf2's topics, which the server's trees stand for.
_TOPIC: Final = "/tf"
_STATIC_TOPIC: Final = "/tf_static"


class TransformListener:
    """Does nothing, because the server receives the transforms of all publishers.

    No thread has to spin, so a lookup may wait in a callback.

    Args:
        buffer: Kept as the attribute `buffer`.
        node: Kept as the attribute `node`.
        spin_thread: Has no effect.
        qos: Has no effect.
        static_qos: Has no effect.
        tf_topic: Must be the default: another topic is another tree (ZENOH_TF_TREE).
        tf_static_topic: Must be the default.
        static_only: Has no effect: a process receives no transforms that it did not ask for, so
            there is no traffic to save. Moving links can be looked up as well.

    Raises:
        InvalidArgumentException: Another topic is asked for; `field` names the argument.
    """

    def __init__(
        self,
        buffer: BufferInterface,
        node: Any = None,
        *,
        spin_thread: bool = False,
        qos: Any = None,
        static_qos: Any = None,
        tf_topic: str = _TOPIC,
        tf_static_topic: str = _STATIC_TOPIC,
        static_only: bool = False,
    ) -> None:
        _check_topic("tf_topic", tf_topic, _TOPIC)
        _check_topic("tf_static_topic", tf_static_topic, _STATIC_TOPIC)
        self.buffer = buffer
        self.node = node

    def unregister(self) -> None:
        """Do nothing."""


class StaticTransformListener(TransformListener):
    """As `TransformListener` with `static_only`.

    Args:
        buffer: Kept as the attribute `buffer`.
        node: Kept as the attribute `node`.
        spin_thread: Has no effect.
        static_qos: Has no effect.
        tf_static_topic: Must be the default: another topic is another tree (ZENOH_TF_TREE).

    Raises:
        InvalidArgumentException: Another topic is asked for.
    """

    def __init__(
        self,
        buffer: BufferInterface,
        node: Any = None,
        *,
        spin_thread: bool = False,
        static_qos: Any = None,
        tf_static_topic: str = _STATIC_TOPIC,
    ) -> None:
        super().__init__(buffer, node, tf_static_topic=tf_static_topic, static_only=True)


def _check_topic(field: str, topic: str, only: str) -> None:
    if topic.strip("/") != only.strip("/"):
        raise InvalidArgumentException(
            f"{field}={topic!r}: the shim has no topics; a separate tree replaces them, named by "
            "ZENOH_TF_TREE or connect(tree=...)",
            field=field,
            value=topic,
        )
