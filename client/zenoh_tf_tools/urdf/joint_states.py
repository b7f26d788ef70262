"""Publishes the moving links of a robot from its sensor_msgs/JointState messages.

The messages come over the client's own Zenoh session: from the nodes and bridges that are on the
network of the server. Each message becomes one put, which the server commits atomically.

Thread safety: all methods.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final

from zenoh_tf import TransformException, wire
from zenoh_tf._net import keys
from zenoh_tf.errors import ProtocolError
from zenoh_tf.ros2.cdr import JointState, decode_joint_state
from zenoh_tf.ros2.keys import JOINT_STATE
from zenoh_tf.ros2.topics import Received, TopicListener
from zenoh_tf_client.client import TransformClient
from zenoh_tf_client.publish.publisher import Publisher

from .kinematics import JointTransforms

#: Larger messages are refused: no robot has as many joints.
MAX_JOINTS: Final = 10_000


@dataclass(slots=True)
class Counts:
    """What became of the messages; see `kinematics.Counts` for their joints."""

    messages: int = 0  # on the topic
    other_topics: int = 0  # messages of other namespaces or domains
    malformed: int = 0
    no_positions: int = 0
    no_stamp: int = 0  # stamp 0: the time of the message is not known
    not_sent: int = 0


class JointStateFeed:
    """Listens until it is closed."""

    def __init__(
        self,
        tf: TransformClient,
        joints: JointTransforms,
        authority: str,
        topic: str = "/joint_states",
        domain: int | None = None,
    ) -> None:
        """Begin to listen.

        Args:
            tf: The client whose session to use.
            joints: The joints of the robot, for this feed alone.
            authority: The name to publish as.
            topic: The topic, with its namespace.
            domain: Accept only messages of this ROS 2 domain; None for all. Bridges to DDS send
                no domain, so theirs are always accepted.

        Raises:
            AccessDenied: The server's access rules do not allow to publish as `authority`.
            ServerUnavailable: The client is closed.
        """
        connection = tf._connection
        connection.check_publish(authority)
        self.topic = "/" + topic.strip("/")
        self._domain = domain
        self._joints = joints
        self._lock = threading.Lock()  # the listener has two threads
        self.counts = Counts()
        #: A topic of the same name in another namespace or domain; "" if none was heard.
        self.other_topic = ""
        #: What was wrong with the last malformed message; "" if none was.
        self.last_error = ""
        self._publisher = Publisher(connection, keys.put(connection.tree, authority, static=False))
        with connection.calls:
            self._listener = TopicListener(
                connection.session,
                self.topic.rsplit("/", 1)[-1],
                JOINT_STATE,
                self._receive,
                self._report,
            )

    def close(self) -> None:
        """Listen no more."""
        self._listener.close()
        self._publisher.undeclare()

    def _receive(self, messages: list[Received]) -> None:
        with self._lock:
            for message in messages:
                topic = message.topic
                if topic.path != self.topic or (
                    self._domain is not None and topic.domain not in (None, self._domain)
                ):
                    self.counts.other_topics += 1
                    self.other_topic = topic.path + (
                        "" if topic.domain is None else f" of domain {topic.domain}"
                    )
                    continue
                self.counts.messages += 1
                try:
                    self._move(decode_joint_state(message.payload.to_bytes(), MAX_JOINTS))
                except ProtocolError as error:
                    self._note(error)
                except TransformException as error:  # too many joints, or the client is closed
                    self.counts.not_sent += 1
                    self.last_error = str(error)

    def _move(self, state: JointState) -> None:
        if not len(state.position):
            self.counts.no_positions += 1
            return
        if state.stamp_ns == 0:
            self.counts.no_stamp += 1
            return
        rows = self._joints.move(state.name, state.position, state.stamp_ns)
        if len(rows):
            self._publisher.put(wire.pack(wire.commit_body(wire.Commit(rows))))

    def _report(self, key: str, error: ProtocolError) -> None:
        """Of a malformed key or attachment."""
        if error.field != "attachment":  # those are not needed here
            with self._lock:
                self._note(error)

    def _note(self, error: ProtocolError) -> None:
        self.counts.malformed += 1
        self.last_error = str(error)
