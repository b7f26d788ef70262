"""Publishes the moving links of a robot from its sensor_msgs/JointState messages.

The messages come over the client's own Zenoh session: from the nodes and bridges that are on the
network of the server. Each message becomes one put, which the server commits atomically. Each node
or bridge that sends some has an authority of its own, so that two that move one joint are seen.

Thread safety: all methods.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import zenoh

from zenoh_tf import TransformException, wire
from zenoh_tf._net import keys
from zenoh_tf.errors import AccessDenied, ProtocolError, ServerUnavailable
from zenoh_tf.ros2.cdr import JointState, decode_joint_state
from zenoh_tf.ros2.keys import JOINT_STATE
from zenoh_tf.ros2.publishers import Publishers
from zenoh_tf.ros2.topics import Received, TopicListener
from zenoh_tf.urdf.kinematics import JointTransforms
from zenoh_tf_client.client import TransformClient
from zenoh_tf_client.publish.publisher import Publisher

#: Larger messages are refused: no robot has as many joints.
MAX_JOINTS: Final = 10_000
#: Senders with an authority of their own; what further ones send goes out as the feed's own.
_MAX_SENDERS: Final = 64
_MAX_AUTHORITY: Final = 255


@dataclass(slots=True)
class Counts:
    """What became of the messages; see `kinematics.Counts` for their joints."""

    messages: int = 0  # on the topic
    other_topics: int = 0  # messages of other namespaces or domains
    malformed: int = 0
    no_positions: int = 0
    no_stamp: int = 0  # stamp 0: the time of the message is not known
    not_sent: int = 0
    disputed_joints: int = 0  # that two senders move by turns


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
            authority: The name to publish as: AUTHORITY/SENDER for the messages of each sender, or
                AUTHORITY alone if the access rules do not allow that.
            topic: The topic, with its namespace.
            domain: Accept only messages of this ROS 2 domain; None for all. Bridges to DDS send
                no domain, so theirs are always accepted.

        Raises:
            AccessDenied: The server's access rules do not allow to publish as `authority`.
            ServerUnavailable: The client is closed.
        """
        connection = tf.connection
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
        #: Joints that two senders move by turns, with both of them.
        self.disputed: dict[str, tuple[str, str]] = {}
        #: Of each joint: who sent it last, and who did before.
        self._senders: dict[str, tuple[str, str]] = {}
        self._connection = connection
        self._authority = authority
        self._is_closed = False
        self._publishers: dict[str, Publisher] = {"": self._publisher(authority)}
        connection.add_user(self)
        self._listen()

    def _listen(self) -> None:
        """Listen in the connection's session."""
        connection = self._connection
        with connection.calls:
            self._sources = Publishers(connection.session, JOINT_STATE, lambda *_: None)
            self._listener = TopicListener(
                connection.session,
                self.topic.rsplit("/", 1)[-1],
                JOINT_STATE,
                self._receive,
                self._report,
            )

    def connection_changed(self) -> None:
        """Listen in the connection's new session."""
        if not self._is_closed:
            with contextlib.suppress(ServerUnavailable, zenoh.ZError):  # closed meanwhile
                self._end()
                self._listen()

    def close(self) -> None:
        """Listen no more."""
        self._is_closed = True
        self._end()
        for publisher in self._publishers.values():
            publisher.undeclare()

    def _end(self) -> None:
        self._listener.close()
        with self._connection.calls:
            self._sources.close()

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
                    state = decode_joint_state(message.payload.to_bytes(), MAX_JOINTS)
                    self._move(self._sources.source(message).authority, state)
                except ProtocolError as error:
                    self._note(error)
                except TransformException as error:  # too many joints, or the client is closed
                    self.counts.not_sent += 1
                    self.last_error = str(error)

    def _move(self, sender: str, state: JointState) -> None:
        if not len(state.position):
            self.counts.no_positions += 1
            return
        if state.stamp_ns == 0:
            self.counts.no_stamp += 1
            return
        self._compare_senders(sender, state.name)
        rows = self._joints.move(state.name, state.position, state.stamp_ns)
        if len(rows):
            self._publisher_of(sender).put(wire.pack(wire.commit_body(wire.Commit(rows))))

    def _compare_senders(self, sender: str, joints: Sequence[str]) -> None:
        """Record joints that another sender has moved since this one did."""
        for joint in joints:
            last, before = self._senders.get(joint, ("", ""))
            if last != sender and self._joints.moves(joint):
                self._senders[joint] = (sender, last)
                if before == sender:  # so it is not a node that has replaced another one
                    self.disputed.setdefault(joint, (last, sender))
        self.counts.disputed_joints = len(self.disputed)

    def _publisher_of(self, sender: str) -> Publisher:
        found = self._publishers.get(sender)
        if found is None:
            authority = f"{self._authority}/{sender}"[:_MAX_AUTHORITY]
            try:
                self._connection.check_publish(authority)
            except AccessDenied:
                authority = self._authority
            if authority == self._authority or len(self._publishers) > _MAX_SENDERS:
                return self._publishers[""]
            found = self._publishers[sender] = self._publisher(authority)
        return found

    def _publisher(self, authority: str) -> Publisher:
        connection = self._connection
        return Publisher(connection, keys.put(connection.tree, authority, static=False))

    def _report(self, key: str, error: ProtocolError) -> None:
        """Of a malformed key or attachment."""
        if error.field != "attachment":  # those are not needed here
            with self._lock:
                self._note(error)

    def _note(self, error: ProtocolError) -> None:
        self.counts.malformed += 1
        self.last_error = str(error)
