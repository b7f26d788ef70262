"""Publishers of ROS 2: nodes and bridges by their liveliness tokens, and names for them.

A message of rmw_zenoh carries its publisher's id, which is a hash of the publisher's token. So it
can be traced to the node. What cannot be traced is named by its topic.

Thread safety: all methods.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from .._core import TransformRows
from ..bounded_map import BoundedMap
from ..text import quoted
from . import attachment, keys
from .keys import MessageType, Topic, TopicPublisher
from .topics import Received

#: What the authorities of ROS 2 publishers begin with.
AUTHORITIES: Final = ("ros2:", "ros2dds:")
#: The name of a server that publishes for others, for instance in `ros2 node list`.
NODE: Final = "zenoh_tf"
#: The authority of such a server at a robot's server, as it is at the site that gathers the robot
#: (docs/how-to/federation.md).
_PUBLISHED_BY_A_SERVER: Final = re.compile(rf":ros2:\d+/{NODE}(@|$)")
#: Sources that are remembered.
_MAX_SOURCES: Final = 4096
#: Most publishers that are remembered. Messages of others are named by their topic, and static
#: transforms that they sent before are not asked for.
MAX_PUBLISHERS: Final = 4096
_LONGEST_AUTHORITY: Final = 255
#: A publisher's first message may overtake its token, whose change another thread reports. So it is
#: waited for: once for each publisher, and over all for this time and this part of the time since.
#: Somebody who invents ids cannot hold others up for longer.
_TOKEN_S: Final = 0.05
_PATIENCE_S: Final = 1.0
_PATIENCE_PART: Final = 0.05
_SHORT_ID: Final = 8  # characters of an id that is part of a name

#: The key of a publisher's messages, the Zenoh id of its session, and its own id; empty: unknown.
Identity = tuple[str, str, bytes]
#: Makes rows of a message's bytes, with the names that the frames have in the tree.
Decode = Callable[[bytes], TransformRows]


@dataclass(slots=True, eq=False)
class TopicSource:
    """Where messages come from: one for each publisher, as far as it is known."""

    authority: str
    key: str
    zid: str | None  # the Zenoh id of the session, if it is known
    gid: bytes | None
    topic: Topic
    is_copy: bool = False  # a server of zenoh-tf, which sends the same on another key, too
    decode: Decode | None = None  # of its messages; the receiver sets it

    @property
    def identity(self) -> Identity:
        """Stands for the publisher. A node that makes its publisher again has another one."""
        return self.key, self.zid or "", self.gid or b""


def is_echo(authority: str) -> bool:
    """True if an authority is a robot's copy of what a server like this one publishes on ROS 2."""
    return _PUBLISHED_BY_A_SERVER.search(authority) is not None


class Publishers:
    """Follows the tokens of all publishers of a type."""

    def __init__(
        self,
        session: zenoh.Session,
        kind: MessageType,
        warn: Callable[[str, str], None],
        found: Callable[[TopicPublisher], None] = lambda _: None,
        gone: Callable[[TopicPublisher], None] = lambda _: None,
    ) -> None:
        """Begin to follow, and return when those that are there now are known.

        Args:
            session: A client's or a router's session.
            kind: The type of the messages.
            warn: Gets a subject and what is wrong with it.
            found: Gets each publisher that appears.
            gone: Gets each one that goes.
        """
        self._kind = kind
        self._warn = warn
        self._found = found
        self._gone = gone
        self._lock = threading.Condition()
        self._patience_s = _PATIENCE_S
        self._waited_s = time.monotonic()
        self._by_token: dict[str, TopicPublisher] = {}
        self._by_gid: dict[bytes, TopicPublisher] = {}
        self._sources = BoundedMap[tuple[str, bytes | None, str | None], TopicSource](_MAX_SOURCES)
        self._subscribers: list[zenoh.Subscriber[Any]] = []
        self._own_zid = str(session.info.zid())
        for tokens in keys.publishers(kind):
            subscriber = session.liveliness().declare_subscriber(
                tokens, self._token_changed, history=True
            )
            self._subscribers.append(subscriber)
            for reply in session.liveliness().get(tokens, timeout=1.0):
                if reply.ok is not None:
                    self._token_changed(reply.ok)

    def close(self) -> None:
        """Follow no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def __len__(self) -> int:
        return len(self._by_token)

    def source(self, message: Received) -> TopicSource:
        """The source of a message; the same one for all messages of a publisher."""
        known = self._sources.get((message.key, message.gid, message.zid))
        return known if known is not None else self._add_source(message)

    # --- tokens

    def _token_changed(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        publisher = keys.parse_publisher(token)
        if publisher is None:
            self._warn("tokens", f"token {quoted(token)} is not one of ROS 2: it is ignored")
            return
        if publisher.zid == self._own_zid:
            return  # this server, which publishes
        gid = None if publisher.topic.is_bridged else attachment.gid_of(publisher.token)
        with self._lock:
            if sample.kind == zenoh.SampleKind.DELETE:
                if gid is not None:
                    self._by_gid.pop(gid, None)
                if self._by_token.pop(token, None) is None:
                    return
                report = self._gone
            elif token in self._by_token:
                return
            elif len(self._by_token) >= MAX_PUBLISHERS:
                self._warn(
                    "tokens",
                    f"more than {MAX_PUBLISHERS} publishers of ROS 2: the messages of the others "
                    "are named by their topics",
                )
                return
            else:
                self._by_token[token] = publisher
                if gid is not None:
                    self._by_gid[gid] = publisher
                    self._lock.notify_all()
                report = self._found
        report(publisher)

    # --- sources

    def _add_source(self, message: Received) -> TopicSource:
        with self._lock:
            self._wait_for_token(message.gid)
            publisher = self._publisher(message)
            authority = self._authority(message, publisher)
            zid = publisher.zid if publisher is not None else message.zid
            is_copy = not message.key.endswith(self._kind.hash) and self._is_server(zid)
            source = TopicSource(authority, message.key, zid, message.gid, message.topic, is_copy)
            # Kept although a token may come later: a publisher must not change its name.
            self._sources[message.key, message.gid, message.zid] = source
        return source

    def _wait_for_token(self, gid: bytes | None) -> None:
        """Requires the lock."""
        if gid is None or not attachment.HAS_GIDS:
            return
        now_s = time.monotonic()
        grown_s = _PATIENCE_PART * (now_s - self._waited_s)
        self._patience_s = min(_PATIENCE_S, self._patience_s + grown_s)
        if self._patience_s >= _TOKEN_S:
            self._lock.wait_for(lambda: gid in self._by_gid, _TOKEN_S)
        self._waited_s = time.monotonic()
        self._patience_s -= self._waited_s - now_s

    def _publisher(self, message: Received) -> TopicPublisher | None:
        """The publisher of a message, by its id, by its session, or because it is the only one."""
        if message.gid is not None and message.gid in self._by_gid:
            return self._by_gid[message.gid]
        found = [each for each in self._by_token.values() if each.topic == message.topic]
        if message.zid is not None:
            found = [each for each in found if each.zid == message.zid]
        # The node that sends an id that no token has may have no token at all.
        has_own_id = message.gid is not None and bool(self._by_gid)
        is_one = len({(each.zid, each.node) for each in found}) == 1
        return found[0] if is_one and not has_own_id else None

    def _is_server(self, zid: str | None) -> bool:
        """True if a session is that of a server of zenoh-tf."""
        return zid is not None and any(
            each.zid == zid and each.node == f"/{NODE}" for each in self._by_token.values()
        )

    def _authority(self, message: Received, publisher: TopicPublisher | None) -> str:
        topic = message.topic
        if topic.is_bridged:
            name = f"ros2dds:/{topic.namespace}"
        elif publisher is not None:
            name = f"ros2:{topic.domain}{publisher.node}"
        else:
            name = f"ros2:{topic.domain}{topic.path}"
            if message.gid is not None:
                name += f"#{message.gid.hex()[:_SHORT_ID]}"
        zid = publisher.zid if publisher is not None else message.zid
        is_unknown = publisher is None and message.gid is None
        if zid is not None and (is_unknown or (publisher and self._has_namesake(publisher))):
            name += f"@{zid[:_SHORT_ID]}"
        return name[:_LONGEST_AUTHORITY]

    def _has_namesake(self, publisher: TopicPublisher) -> bool:
        """True if another session has a node, or a bridge, of the same name."""
        return any(
            each.zid != publisher.zid
            and each.node == publisher.node
            and each.topic.domain == publisher.topic.domain
            and (each.node is not None or each.topic.namespace == publisher.topic.namespace)
            for each in self._by_token.values()
        )
