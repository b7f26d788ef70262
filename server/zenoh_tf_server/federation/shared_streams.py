"""One Zenoh subscriber for the streams of all robots that a pattern finds, or of one robot.

Zenoh compares each message with the key expression of each subscriber of the session: with a
thousand of them that took 60 us a message, two thirds of a site's processor time.

What a robot has sent waits in its inbox, up to so many messages and as many bytes as it may have:
all robots share the memory for messages that wait. Then its oldest message is lost, and asked for
again.

Thread safety: all methods, but `distribute` and those of inboxes are for one thread.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf._net import keys
from zenoh_tf.mirrors.shared_bytes import SharedBytes

from .settings import RobotAddress, RobotPattern

#: Messages of all robots, and of one that has a subscriber of its own, that wait for `distribute`.
#: It comes every few milliseconds, and before any robot's messages are applied.
_RING_MESSAGES: Final = 1 << 13
_OWN_RING_MESSAGES: Final = 256
#: Messages of one robot that wait.
_INBOX_MESSAGES: Final = 256
#: What a message costs beside its bytes, roughly.
_OVERHEAD_BYTES: Final = 500


class Inbox:
    """What stands for the subscriber of one robot's stream."""

    def __init__(
        self,
        inboxes: dict[str, Inbox],
        chunk: str,
        room: SharedBytes,
        ended: Callable[[], object] = lambda: None,
    ) -> None:
        """Calls `ended` when nothing is received any more."""
        self._ended = ended
        self._inboxes = inboxes
        self._chunk = chunk
        self._room = room
        self._samples: deque[zenoh.Sample] = deque()
        self._bytes = 0
        #: How many messages were lost because too many, or too many bytes, waited.
        self.lost = 0
        inboxes[chunk] = self

    @property
    def handler(self) -> Inbox:
        """What messages are received from."""
        return self

    def add(self, sample: zenoh.Sample) -> None:
        """Let a message wait, in place of the oldest ones if there is no room."""
        size = _size(sample)
        while len(self._samples) >= _INBOX_MESSAGES or not self._room.take(self._bytes, size):
            self.lost += 1
            if self.try_recv() is None:
                return
        self._samples.append(sample)
        self._bytes += size

    def try_recv(self) -> zenoh.Sample | None:
        """Return the next message; None if none waits."""
        if not self._samples:
            return None
        sample = self._samples.popleft()
        self._bytes -= _size(sample)
        self._room.give_back(_size(sample))
        return sample

    def undeclare(self) -> None:
        """Receive no more."""
        if self._inboxes.get(self._chunk) is self:
            del self._inboxes[self._chunk]
        with contextlib.suppress(IndexError):  # the other thread receives some meanwhile
            while self.try_recv() is not None:
                pass
        self._ended()


class SharedStreams:
    """The streams of the trees of a key expression."""

    def __init__(
        self, session: zenoh.Session, key: str, ring_messages: int, room: SharedBytes
    ) -> None:
        self._room = room
        self._ring_messages = ring_messages
        self._inboxes: dict[str, Inbox] = {}  # by the tree's chunk of a key
        self._subscriber = session.declare_subscriber(
            key,
            RingChannel(ring_messages),
            # A pattern may match the site's own tree.
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def inbox(self, tree: str, ended: Callable[[], object] = lambda: None) -> Inbox:
        """Return a new inbox for the messages of a tree, instead of any before."""
        return Inbox(self._inboxes, keys.escape(tree), self._room, ended)

    def close(self) -> None:
        """Receive no more."""
        with contextlib.suppress(zenoh.ZError):  # the session is closed
            self._subscriber.undeclare()

    def distribute(self) -> bool:
        """Put the messages that have come into the inboxes. Others are dropped. False: no more
        come, as the session is closed."""
        receive = self._subscriber.handler.try_recv
        inboxes = self._inboxes
        try:
            for _ in range(self._ring_messages):
                sample = receive()
                if sample is None:
                    break
                inbox = inboxes.get(keys.tree_chunk(str(sample.key_expr)))
                if inbox is not None:
                    inbox.add(sample)
        except (zenoh.ZError, RuntimeError):  # undeclared
            return False
        return True


def of_pattern(session: zenoh.Session, pattern: RobotPattern, room: SharedBytes) -> SharedStreams:
    """The streams of the trees that match a pattern, of its interest."""
    interest = pattern.share.interest
    key = keys.streams_of_trees(pattern.before, pattern.after, interest.id if interest else "")
    return SharedStreams(session, key, _RING_MESSAGES, room)


def of_robot(session: zenoh.Session, address: RobotAddress, room: SharedBytes) -> SharedStreams:
    """The stream of one robot's tree, of its interest."""
    interest = address.share.interest
    key = keys.streams(address.tree, interest.id if interest else "")
    return SharedStreams(session, key, _OWN_RING_MESSAGES, room)


def _size(sample: zenoh.Sample) -> int:
    return len(sample.payload) + _OVERHEAD_BYTES
