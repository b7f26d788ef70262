"""`TransformListener`, `StaticTransformListener`: fill a buffer from tf2's topics."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable
from typing import Any

from zenoh_tf import threads
from zenoh_tf.errors import InvalidArgumentException, TransformException, must_be

from . import topics
from .buffer import Buffer, BufferInterface

log = logging.getLogger("zenoh_tf.tf2")


class TransformListener:
    """Fills a buffer that has a tree of its own from the topics of a node, or of the process.

    A node of rclpy receives from all of ROS. Without one, or with an object that has only a name
    (`get_name`), what the broadcasters of this process send in the same way arrives, in the thread
    that sends. If the buffer is on a server's tree, this
    does nothing, because the server receives the transforms of all publishers: no thread has to
    spin, so a lookup may wait in a callback.

    Args:
        buffer: What is filled, of any class that has `set_transform` and `set_transform_static`;
            kept as the attribute `buffer`.
        node: A node of rclpy; kept as the attribute `node`.
        spin_thread: Whether a thread of this object spins the node.
        qos: The quality of service of the node's topic `tf_topic`; None for tf2's.
        static_qos: That of `tf_static_topic`.
        tf_topic: The topic of moving transforms. On a server's tree both must be the defaults:
            another topic is another tree (ZENOH_TF_TREE).
        tf_static_topic: The topic of static transforms.
        static_only: Receive static transforms only.

    Raises:
        InvalidArgumentException: Another topic is asked for on a server's tree, or `buffer` is no
            buffer or `node` no node; `field` names the argument.
    """

    def __init__(
        self,
        buffer: BufferInterface,
        node: Any = None,
        *,
        spin_thread: bool = False,
        qos: Any = None,
        static_qos: Any = None,
        tf_topic: str = topics.TF,
        tf_static_topic: str = topics.TF_STATIC,
        static_only: bool = False,
    ) -> None:
        setters = hasattr(buffer, "set_transform") and hasattr(buffer, "set_transform_static")
        if not setters and not isinstance(buffer, BufferInterface):
            raise must_be("buffer", "a Buffer", buffer)
        topics.check_node(node)
        self.buffer = buffer
        self.node = node
        self._ends: list[Callable[[], object]] = []
        if isinstance(buffer, Buffer) and buffer.is_on_server:
            for field, topic in (("tf_topic", tf_topic), ("tf_static_topic", tf_static_topic)):
                if topic.strip("/") != field.removesuffix("_topic"):
                    raise InvalidArgumentException(
                        f"{field}={topic!r}: a server has no topics; a separate tree replaces "
                        "them, named by ZENOH_TF_TREE or connect(tree=...)",
                        field=field,
                        value=topic,
                    )
        elif setters:
            if not static_only:
                self._listen(tf_topic, qos, static=False)
            self._listen(tf_static_topic, static_qos, static=True)
            if spin_thread and topics.has_topics(node):
                from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415 - ROS 2's

                executor = SingleThreadedExecutor()
                executor.add_node(node)
                threads.start("tf2 listener", executor.spin)
                self._ends.append(executor.shutdown)

    def unregister(self) -> None:
        """Fill the buffer no longer."""
        while self._ends:
            self._ends.pop()()

    def _listen(self, topic: str, qos: Any, *, static: bool) -> None:
        known = weakref.ref(self.buffer)

        def receive(message: Any) -> None:
            buffer: Any = known()
            for transform in () if buffer is None else message.transforms:
                store = buffer.set_transform_static if static else buffer.set_transform
                try:  # each by itself, as whom tf2's listeners store all
                    store(transform, "default_authority")
                except TransformException as error:
                    log.warning("a transform of a listener was rejected: %s", error)

        end = topics.subscribe(self.node, topic, receive, qos, static=static)
        self._ends.append(end)
        if not topics.has_topics(self.node):  # a node keeps its subscriptions itself
            weakref.finalize(self.buffer, end)


class StaticTransformListener(TransformListener):
    """As `TransformListener` with `static_only`, and with its other arguments."""

    def __init__(self, buffer: BufferInterface, node: Any = None, **options: Any) -> None:
        super().__init__(buffer, node, static_only=True, **options)
