"""One Zenoh subscriber for the streams of all robots that a pattern finds.

Zenoh compares each message with the key expression of each subscriber of the session: with a
thousand of them that took 60 us a message, two thirds of a site's processor time.

Thread safety: all methods, but `distribute` is for one thread.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import zenoh
from zenoh.handlers import RingChannel

from zenoh_tf._net import keys

from .settings import RobotPattern

#: Messages of all robots that wait for `distribute`. It comes every few milliseconds.
_RING_MESSAGES: Final = 1 << 13
#: Messages of one robot that wait, as in a ring of its own; then its oldest one is lost, and asked
#: for again.
_INBOX_MESSAGES: Final = 256


class Inbox:
    """What stands for the subscriber of one robot's stream."""

    def __init__(self, inboxes: dict[str, Inbox], chunk: str) -> None:
        self._inboxes = inboxes
        self._chunk = chunk
        self.samples: deque[zenoh.Sample] = deque(maxlen=_INBOX_MESSAGES)
        inboxes[chunk] = self

    @property
    def handler(self) -> Inbox:
        """What messages are received from."""
        return self

    def try_recv(self) -> zenoh.Sample | None:
        """Return the next message; None if none waits."""
        return self.samples.popleft() if self.samples else None

    def undeclare(self) -> None:
        """Receive no more."""
        if self._inboxes.get(self._chunk) is self:
            del self._inboxes[self._chunk]


class SharedStreams:
    """The streams of the trees that match a pattern, of one interest."""

    def __init__(self, session: zenoh.Session, pattern: RobotPattern) -> None:
        interest = pattern.share.interest
        self._inboxes: dict[str, Inbox] = {}  # by the tree's chunk of a key
        self._subscriber = session.declare_subscriber(
            keys.streams_of_trees(pattern.before, pattern.after, interest.id if interest else ""),
            RingChannel(_RING_MESSAGES),
            # A pattern may match the site's own tree.
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def inbox(self, tree: str) -> Inbox:
        """Return a new inbox for the messages of a tree, instead of any before."""
        return Inbox(self._inboxes, keys.escape(tree))

    def distribute(self) -> None:
        """Put the messages that have come into the inboxes. Others are dropped."""
        receive = self._subscriber.handler.try_recv
        inboxes = self._inboxes
        for _ in range(_RING_MESSAGES):
            sample = receive()
            if sample is None:
                return
            inbox = inboxes.get(keys.tree_chunk(str(sample.key_expr)))
            if inbox is not None:
                inbox.samples.append(sample)
