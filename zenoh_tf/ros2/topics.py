"""Subscribes to a topic of all ROS 2 peers on a Zenoh network, in every domain and namespace.

    listener = TopicListener(session, "joint_states", JOINT_STATE, receive)

The session must be a client's or a router's: rmw_zenoh's nodes are peers that are connected to a
router only, so another peer gets nothing from them.

Thread safety: all functions. `receive` is called on the listener's threads, of which it has one for
rmw_zenoh and one for bridges; while it runs, Zenoh holds the publishers back.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import zenoh
from zenoh.handlers import FifoChannel

from .. import threads
from .._net import keys as service_keys
from ..bounded_map import BoundedMap
from ..errors import ProtocolError, TransformException
from ..text import quoted
from . import attachment, keys
from .keys import MessageType, Topic

#: Messages between Zenoh's receiver and a listener's thread.
_CHANNEL: Final = 256
#: Most messages that are handed over at once.
_BATCH: Final = 64
#: Keys whose topic is remembered.
_KNOWN_KEYS: Final = 4096


@dataclass(slots=True)
class Received:
    """A message of a ROS 2 peer."""

    key: str
    topic: Topic
    payload: zenoh.ZBytes  # in CDR
    number: int | None  # the publisher's number or time of the message
    sent_ns: int | None  # when it was sent, by the clock of the publisher's host
    gid: bytes | None  # the publisher's id, see `attachment`
    zid: str | None  # the Zenoh id of its session


class Reception:
    """Turns samples of a topic into messages, and reports what is malformed about them."""

    def __init__(self, kind: MessageType, report: Callable[[str, ProtocolError], None]) -> None:
        """`report` gets the key and the error. Its field is "key", and the sample is dropped, or
        "attachment", and the message counts as one without."""
        self._kind = kind
        self._report = report
        self._topics = BoundedMap[str, Topic | None](_KNOWN_KEYS)

    def message(self, sample: zenoh.Sample, zid: str | None = None) -> Received | None:
        """The message of a sample; None if it is none. `zid`: the publisher's, if it is known."""
        if sample.kind != zenoh.SampleKind.PUT:
            return None
        key = str(sample.key_expr)
        try:
            topic = self._topics[key]
        except KeyError:
            topic = self._topic(key)
        if topic is None:
            return None
        number = sent_ns = gid = None
        if sample.attachment is not None:
            try:
                found = attachment.decode(sample.attachment.to_bytes())
                number, sent_ns, gid = found.number, found.stamp_ns, found.gid
            except TransformException as error:
                assert isinstance(error, ProtocolError)
                self._report(key, error)
        elif sample.timestamp is not None:
            number = sent_ns = sample.timestamp.get_time_as_ntp64().as_nanos()
        if zid is None and (info := sample.source_info) is not None:
            zid = str(info.source_id.zid)
        return Received(key, topic, sample.payload, number, sent_ns, gid, zid)

    def _topic(self, key: str) -> Topic | None:
        if key.startswith(f"{service_keys.PREFIX}/"):
            return None  # the service's own: an authority may be named "tf"
        topic = keys.parse_data(key, self._kind)
        if topic is None:
            # Not remembered: bad keys must not push good ones out.
            self._report(key, ProtocolError(f"key {quoted(key)} is not of ROS 2", field="key"))
            return None
        self._topics[key] = topic
        return topic


class TopicListener:
    """Receives a topic until it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        topic: str,
        kind: MessageType,
        receive: Callable[[list[Received]], None],
        report: Callable[[str, ProtocolError], None],
    ) -> None:
        """Begin to receive.

        Args:
            session: A client's or a router's session.
            topic: The last part of the topic's name, such as "joint_states".
            kind: Its type.
            receive: Gets messages in the order in which they came; must not raise.
            report: Gets malformed keys and attachments, see `Reception`.
        """
        self._receive = receive
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._threads: list[threading.Thread] = []
        for data in keys.data(topic, kind):
            channel: FifoChannel[zenoh.Sample] = FifoChannel(_CHANNEL)
            subscriber = session.declare_subscriber(
                # What this session publishes itself must not come back.
                data,
                channel,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            # The thread receives on the handler: undeclaring a subscriber fails while a thread
            # waits on the subscriber itself.
            self._subscribers.append(subscriber)
            reception = Reception(kind, report)
            work = threads.start(f"ros2-{topic}", self._run, subscriber.handler, reception)
            self._threads.append(work)

    def close(self) -> None:
        """Receive no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        threads.join(*self._threads)

    def _run(self, handler: Any, reception: Reception) -> None:
        try:
            while True:
                sample = handler.recv()
                messages: list[Received] = []
                while sample is not None:
                    message = reception.message(sample)
                    if message is not None:
                        messages.append(message)
                        if len(messages) == _BATCH:
                            break
                    sample = handler.try_recv()
                if messages:
                    self._receive(messages)
        except zenoh.ZError:  # undeclared
            return
